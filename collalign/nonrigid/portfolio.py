"""The portfolio: many starts, distinct candidates refined and judged, the mirror image of each beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from collalign.nonrigid.evidence import Evidence, judge
from collalign.nonrigid.masks import candidate_mask
from collalign.nonrigid.options import NonrigidOptions
from collalign.nonrigid.refine import Refiner
from collalign.nonrigid.relaxed import relaxation_starts
from collalign.nonrigid.starts import descriptor_start, sign_starts
from collalign.nonrigid.surface import SpectralShape
from data_tools.arrays import FloatArray
from pairwise.functional_map import FunctionalMap, icp
from pairwise.local_search import LocalMinima, merge
from pairwise.status import Status

#: Distinct starts that are refined on few samples, and how few.
NUM_SCREENED, NUM_SCREEN_SAMPLES = 12, 400
#: Refinement on few samples ends with this number of functions.
SCREEN_LAST = 60
#: Starts closer than this in the lowest 8 functions (Frobenius norm) are one.
SAME_START = 1.0
#: Refined maps closer than this in the lowest 8 functions are one.
SAME_MAP = 0.7
#: Functions in which a map is composed with a symmetry, and in which full refinement begins.
NUM_COMPOSED = 30
#: Functions of the paper's ICP.
ICP_DIM = 30
#: Functions in which maps are compared with each other.
NUM_COMPARED = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """A refined map of dense samples with its evidence."""

    functional_map: FunctionalMap
    evidence: Evidence
    origin: str

    @property
    def score(self) -> float:
        """The lower the better."""
        return self.evidence.score


def find_candidates(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> tuple[list[Refined], Status]:
    """Return distinct refined candidates, best evidence first, and how the search ended.

    At most ``options.num_candidates`` are kept. Starts are screened with few samples and functions; the best, and
    what becomes of them when they are composed with the target's own mirror symmetry, are refined with all.
    """
    starts, status = portfolio_starts(target, source, options)
    screen = Refiner(target, source, num_dense=NUM_SCREEN_SAMPLES, first=18, last=SCREEN_LAST, factor=1.35)
    screened = [
        judged(target, source, screen.from_rotation(starts.rotations[i]), str(starts.origins[i]))
        for i in distinct_starts(starts, NUM_SCREENED)
    ]
    best = distinct_maps(screened)[: options.num_candidates]
    best = distinct_maps([*best, *mirrored(target, source, best, screen)])[: options.num_candidates]
    finish = finish_by_icp if options.ends_with_icp else finish_by_zoomout
    return distinct_maps(finish(target, source, best)), status


def finish_by_zoomout(target: SpectralShape, source: SpectralShape, screened: list[Refined]) -> list[Refined]:
    """Refine with all dense samples and functions."""
    last = len(target.eigenvalues) + 1
    full = Refiner(target, source, num_dense=len(target.dense), first=NUM_COMPOSED, last=last, factor=1.2)
    refined = []
    for candidate in screened:
        coarse = candidate.functional_map.C_source_target[:NUM_COMPOSED, :NUM_COMPOSED]
        refined.append(judged(target, source, full.from_functional_map(coarse), candidate.origin))
    return refined


def finish_by_icp(target: SpectralShape, source: SpectralShape, screened: list[Refined]) -> list[Refined]:
    """Refine by functional-map ICP in 30 functions on all dense samples."""
    refined = []
    for candidate in screened:
        u, _, vt = np.linalg.svd(candidate.functional_map.C_source_target[1 : ICP_DIM + 1, 1 : ICP_DIM + 1])
        refined.append(judged(target, source, icp_map(target, source, (u @ vt).T), candidate.origin))
    return refined


def icp_map(target: SpectralShape, source: SpectralShape, rotation_target_source: FloatArray) -> FunctionalMap:
    """Return functional-map ICP on the dense samples, with the constant function put in front of its map."""
    dim = len(rotation_target_source)
    on_target, on_source = target.functions[target.dense, :dim], source.functions[source.dense, :dim]
    found = icp(on_target, on_source, rotation_target_source)
    c_source_target = np.eye(dim + 1)
    c_source_target[1:, 1:] = found.C_source_target
    return replace(found, C_source_target=c_source_target)


def portfolio_starts(
    target: SpectralShape, source: SpectralShape, options: NonrigidOptions
) -> tuple[LocalMinima, Status]:
    """Return the minima that all ways to start lead to, best energy first, and how the relaxation ended if used."""
    samples = source.samples[: options.num_source]
    allowed = candidate_mask(target, source, samples, options)
    parts = [sign_starts(target, source, samples, allowed), descriptor_start(target, source, samples, allowed)]
    status = Status.CONVERGED
    if options.use_relaxation:
        relaxed, status = relaxation_starts(target, source, samples, allowed, options)
        parts.append(relaxed)
    return merge(parts), status


def distinct_starts(starts: LocalMinima, num: int) -> list[int]:
    """Return positions of the first starts that differ in the lowest functions; each origin has its best one."""
    size = NUM_COMPARED
    kept: list[int] = []
    for i in range(len(starts)):
        gaps = [np.linalg.norm(starts.rotations[i, :size, :size] - starts.rotations[j, :size, :size]) for j in kept]
        if all(gap >= SAME_START for gap in gaps):
            kept.append(i)
    firsts = {str(origin): i for i, origin in reversed(list(enumerate(starts.origins)))}
    chosen = kept[:num]
    return chosen + [i for i in sorted(firsts.values()) if i not in chosen]


def distinct_maps(refined: list[Refined]) -> list[Refined]:
    """Return the candidates best evidence first, of each set of nearly equal ones only the best."""
    kept: list[Refined] = []
    for candidate in sorted(refined, key=lambda c: c.score):
        if all(_gap(candidate, other) >= SAME_MAP for other in kept):
            kept.append(candidate)
    return kept


def mirrored(target: SpectralShape, source: SpectralShape, best: list[Refined], refiner: Refiner) -> list[Refined]:
    """Return the candidates composed with the target's mirror symmetry and refined; none if it has none."""
    if not target.mirror.size:
        return []
    composed = []
    for candidate in best:
        c = candidate.functional_map.C_source_target
        size = min(NUM_COMPOSED, len(c), len(target.mirror))
        flipped = refiner.from_functional_map(c[:size, :size] @ target.mirror[:size, :size])
        composed.append(judged(target, source, flipped, f"{candidate.origin}, mirrored"))
    return composed


def _gap(first: Refined, second: Refined) -> float:
    size = NUM_COMPARED + 1
    a, b = first.functional_map.C_source_target, second.functional_map.C_source_target
    return float(np.linalg.norm(a[:size, :size] - b[:size, :size]))


def judged(target: SpectralShape, source: SpectralShape, refined: FunctionalMap, origin: str) -> Refined:
    """Return a refined map with its evidence."""
    return Refined(functional_map=refined, evidence=judge(target, source, refined), origin=origin)
