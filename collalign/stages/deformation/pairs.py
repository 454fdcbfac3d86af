"""The jobs of pairs: candidate maps from poses, and one map refined from where the collection wants it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from collalign.confidence.candidate_model import EVIDENCE
from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.records import Record
from collalign.nonrigid.evidence import MIXED_ORIENTATION
from collalign.nonrigid.portfolio import is_same_map
from collalign.nonrigid.pose_maps import PoseMapper
from collalign.nonrigid.refine import Refiner
from collalign.nonrigid.surface.posed import first_samples
from collalign.stages.evidence.candidates import PoseWeigher
from collalign.stages.evidence.surfaces import surface_from_record
from collalign.stages.stored_types import samples_from_record
from data_tools.arrays import FloatArray

#: Dense samples and eigenfunctions of candidate maps: few, so that one takes some 20 ms.
NUM_SCREEN_POINTS, NUM_SCREEN_FUNCTIONS = 400, 60
#: Candidates of each pair that the collection chooses from.
MAX_CANDIDATES = 3
#: Functions, the constant one included, that the full refinement starts with, and how fast they grow.
FIRST_SIZE, GROWTH = 30, 1.3


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidatesTask:
    """Poses of a pair that start maps, shape (m, 3, 3); surfaces and samples come from the shared table, by key."""

    target_key: str
    source_key: str
    target_surface: str
    source_surface: str
    starts: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinementTask:
    """A coarse functional map ``C_source_target`` of a pair that is refined on all samples."""

    target_surface: str
    source_surface: str
    coarse: FloatArray


def candidate_maps(task: CandidatesTask, shared: SharedTable) -> Record:
    """Return the maps that poses of a pair lead to, weighed by all evidence; runs inside a worker.

    Returns
    -------
    dict
        ``maps`` (m, k, k), ``C_source_target`` of each candidate, the likeliest first, and their ``log_odds`` (m,).
    """
    target, source = (
        first_samples(surface_from_record(shared[key], key), NUM_SCREEN_POINTS, NUM_SCREEN_FUNCTIONS)
        for key in (task.target_surface, task.source_surface)
    )
    samples = [shared.made(key, samples_from_record) for key in (task.target_key, task.source_key)]
    mapper = PoseMapper(target, source)
    weigher = PoseWeigher(samples[0], samples[1], mapper)
    found = []
    for start in task.starts:
        chirality = float(np.sign(np.linalg.det(start)))
        plain = mapper.map_from(start)
        for candidate in (plain, mapper.oriented(plain, preserving=chirality > 0)):
            weighed = weigher.weigh(candidate, chirality=chirality)
            keeps_sides = not weighed.evidence[EVIDENCE.index("orientation")] < MIXED_ORIENTATION
            found.append((keeps_sides, weighed.score, candidate.C_source_target))
    # Maps that swap left and right are for pairs that have no others: most evidence says the same of both.
    able = [one for one in found if one[0]] or found
    kept: list[tuple[float, FloatArray]] = []
    for _, score, c in sorted(able, key=lambda one: -one[1]):
        if not any(is_same_map(c, other) for _, other in kept):
            kept.append((score, c))
    best = kept[:MAX_CANDIDATES]
    return {"maps": np.stack([c for _, c in best]), "log_odds": np.array([score for score, _ in best])}


def refine_map(task: RefinementTask, shared: SharedTable) -> Record:
    """Return the ``map`` (k, k) in all functions that a coarse one leads to on all samples; runs inside a worker."""
    target, source = (
        surface_from_record(shared[key], key).spectral for key in (task.target_surface, task.source_surface)
    )
    refiner = Refiner(
        target,
        source,
        num_dense=max(len(target.dense), len(source.dense)),
        first=FIRST_SIZE,
        last=min(len(target.eigenvalues), len(source.eigenvalues)) + 1,
        factor=GROWTH,
    )
    return {"map": refiner.from_functional_map(task.coarse).C_source_target}
