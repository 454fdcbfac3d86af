"""The evidence stage: every pose of a pair, and crude poses besides, start a map; map and pose are weighed together.

The rotation of a map is a candidate of the pair beside its rigid poses, since parts that bend mislead closest points
more than they mislead maps. Each candidate keeps what every kind of evidence says of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.confidence.candidate_model import EVIDENCE, evidence_score
from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.nonrigid.pose_maps import PoseMapper, axis_poses
from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.evidence.candidates import PoseWeigher, WeighedPose, distinct
from collalign.stages.evidence.surfaces import prepare_surfaces, surface_from_record
from collalign.stages.record_fields import checked
from collalign.stages.stored_types import samples_from_record
from data_tools.arrays import FloatArray, as_floats, as_indices, as_rotations, read_only
from data_tools.errors import InputError

#: Changes whenever the same surfaces and poses would give other candidates.
EVIDENCE_VERSION = "evidence-2"


@dataclass(frozen=True, kw_only=True, eq=False)
class EvidenceTask:
    """What a worker needs to weigh poses of one pair; samples and surfaces come from the shared table.

    ``starts`` are the poses that start maps, shape (m, 3, 3); ``is_first`` adds those of the principal axes, and
    the maps that eigenfunctions start.
    """

    target_key: str
    source_key: str
    target_surface: str
    source_surface: str
    group: str
    starts: FloatArray
    is_first: bool


def weigh_pair(task: EvidenceTask, shared: SharedTable) -> Record:
    """Weigh the poses of one pair and find those of its maps; runs inside a worker.

    Returns
    -------
    dict
        ``rotations`` (m, 3, 3), ``maps`` (m, k), ``evidence`` (m, 7), the best candidate first.
    """
    samples = [shared.made(key, samples_from_record) for key in (task.target_key, task.source_key)]
    surfaces = [surface_from_record(shared[key], key) for key in (task.target_surface, task.source_surface)]
    weigher = PoseWeigher(samples[0], samples[1], PoseMapper(surfaces[0], surfaces[1]))
    mirrored, starts = task.group == "O", task.starts
    if task.is_first:
        starts = np.concatenate([starts, axis_poses(surfaces[0], surfaces[1], mirrored=mirrored)])
    candidates = [weigher.candidate_from(start) for start in starts]
    if task.is_first:
        candidates += weigher.candidates_from_signs(mirrored=mirrored)
    found = distinct(candidates)
    return {
        "rotations": np.stack([candidate.rotation for candidate in found]),
        "maps": np.stack([candidate.point_map for candidate in found]).astype(np.int32),
        "evidence": np.stack([candidate.evidence for candidate in found]),
    }


def weigh_pairs(session: AlignSession, shapes: Shapes, pairs: Sequence[Pair]) -> list[Pair]:
    """Return the pairs with the candidates of their maps, and with the log-odds and evidence of these.

    Pairs whose shapes have no surface (point clouds) keep their candidates, with the log-odds of their energies.

    Parameters
    ----------
    session : Session
        Its group is decided.
    shapes : Shapes
    pairs : sequence of Pair
        With their first, rigid candidates.
    """
    own = {e: np.ascontiguousarray(pair.rotations[:, :3, :3]) for e, pair in enumerate(pairs)}
    records = weigh_starts(session, shapes, pairs, own, is_first=True)
    weighed = [by_energy(pair) for pair in pairs]
    for e, record in records.items():
        weighed[e] = with_evidence(pairs[e], record, shapes.label(pairs[e].target, pairs[e].source))
    return weighed


def weigh_starts(
    session: AlignSession, shapes: Shapes, pairs: Sequence[Pair], starts: Mapping[int, FloatArray], *, is_first: bool
) -> dict[int, Record]:
    """Return what maps of some pairs make of some poses, by position of the pair, as :func:`weigh_pair` does.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    pairs : sequence of Pair
    starts : mapping of int to ndarray (m, 3, 3)
        Poses of each pair that is to be weighed; pairs without surfaces are left out.
    is_first : bool
        Start from the pairings of the principal axes and from signs of eigenfunctions as well.
    """
    surfaces = prepare_surfaces(session, shapes)
    tasks = {}
    for e, poses in starts.items():
        pair = pairs[e]
        if pair.target in surfaces and pair.source in surfaces:
            tasks[e] = EvidenceTask(
                target_key=shapes.keys[pair.target],
                source_key=shapes.keys[pair.source],
                target_surface=surfaces[pair.target],
                source_surface=surfaces[pair.source],
                group=session.options.group,
                starts=poses,
                is_first=is_first,
            )
    keys = {e: _key(task) for e, task in tasks.items()}
    require = session.store.require
    used = [("shapes", set(shapes.keys)), ("surfaces", set(surfaces.values()))]
    with SharedTable.create((key, require(kind, key)) for kind, names in used for key in sorted(names)) as table:
        failures = session.compute(
            "evidence",
            weigh_pair,
            {keys[e]: (shapes.label(pairs[e].target, pairs[e].source), task) for e, task in tasks.items()},
            time_limit_s=session.run.pair_time_limit_s,
            strict=session.options.strict,
            shared=table,
        )
    return {e: require("evidence", key) for e, key in keys.items() if key not in failures}


def by_energy(pair: Pair) -> Pair:
    """Return the pair with log-odds by the energies of its candidates alone."""
    evidence = np.full((len(pair.energies), len(EVIDENCE)), np.nan)
    evidence[:, EVIDENCE.index("energy")] = pair.energies
    return replace(pair, log_odds=read_only(evidence_score(evidence)), evidence=read_only(evidence))


def with_evidence(pair: Pair, record: Record, label: str) -> Pair:
    """Return the pair with the candidates of its maps behind its own, which no longer take part.

    Parameters
    ----------
    pair : Pair
        With its rigid candidates alone.
    record : dict
        From :func:`weigh_pair`, or anything else.
    label : str
        Names the pair in the message.

    Raises
    ------
    StoreError
        If a field of the record is missing, of another shape, or impossible.
    """
    silent = replace(by_energy(pair), log_odds=read_only(np.full(len(pair.energies), -np.inf)))
    return with_candidates(silent, weighed_poses(record, pair.maps.shape[1], label))


def with_candidates(pair: Pair, found: Sequence[WeighedPose]) -> Pair:
    """Return a weighed pair with further candidates at its end."""
    rotations = np.tile(np.eye(pair.rotations.shape[-1]), (len(found), 1, 1))
    rotations[:, :3, :3] = [candidate.rotation for candidate in found]
    evidence = np.stack([candidate.evidence for candidate in found])
    energies = evidence[:, EVIDENCE.index("energy")]
    return replace(
        pair,
        rotations=read_only(np.concatenate([pair.rotations, rotations])),
        maps=read_only(np.concatenate([pair.maps, [candidate.point_map for candidate in found]])),
        energies=read_only(np.concatenate([pair.energies, energies])),
        log_odds=read_only(np.concatenate([pair.log_odds, evidence_score(evidence)])),
        evidence=read_only(np.concatenate([pair.evidence, evidence])),
    )


def weighed_poses(record: Record, num_samples: int, label: str) -> list[WeighedPose]:
    """Check a record of :func:`weigh_pair` and return its poses, at least one.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"evidence of {label}"):
        evidence = as_floats(record["evidence"], "evidence", shape=(None, len(EVIDENCE)))
        num = len(evidence)
        poses = as_rotations(as_floats(record["rotations"], "rotations", shape=(num, 3, 3)), "rotations")
        maps = as_indices(record["maps"], "maps", upper=num_samples, shape=(num, num_samples))
        if not num:
            raise InputError("holds no pose")
    return [
        WeighedPose(rotation=pose, point_map=point_map, evidence=row)
        for pose, point_map, row in zip(poses, maps, evidence, strict=True)
    ]


def _key(task: EvidenceTask) -> str:
    settings = {"group": task.group, "starts": task.starts.tolist(), "is_first": task.is_first}
    return fingerprint(EVIDENCE_VERSION, settings, task.target_surface, task.source_surface)
