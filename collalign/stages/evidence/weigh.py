"""The evidence stage: every pose of a pair, and crude poses besides, start a map; map and pose are weighed together.

The rotation of a map is a candidate of the pair beside its rigid poses, since parts that bend mislead closest points
more than they mislead maps. Each candidate keeps what every kind of evidence says of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.nonrigid.functional_map import FunctionalMap, mutual_nearest_rows
from collalign.nonrigid.pose_maps import PoseMapper, axis_poses
from collalign.options import AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.evidence.odds import EVIDENCE, evidence_score
from collalign.stages.evidence.surfaces import prepare_surfaces, surface_from_record
from collalign.stages.stored_types import samples_from_record
from data_tools.arrays import FloatArray, IntArray, as_floats, as_indices, as_rotations, read_only
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError, StoreError
from data_tools.rotations import rotation_angle_deg

#: Changes whenever the same surfaces and poses would give other candidates.
EVIDENCE_VERSION = "evidence-1"
#: Rotations of maps within this angle are one candidate, the one that more speaks for.
SAME_CANDIDATE_DEG = 15.0
#: Candidates kept, the ones that most speaks for.
MAX_CANDIDATES = 10
#: Weight of unit normals beside positions of root mean square radius 1 where surfaces are compared.
SURFACE_NORMAL_WEIGHT = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class EvidenceTask:
    """What a worker needs to weigh poses of one pair; samples and surfaces come from the shared table.

    ``starts`` are the poses that start maps, shape (m, 3, 3); ``with_axes`` adds those of the principal axes.
    """

    target_key: str
    source_key: str
    target_surface: str
    source_surface: str
    group: str
    starts: FloatArray
    with_axes: bool


def weigh_pair(task: EvidenceTask, shared: SharedTable) -> Record:
    """Weigh the poses of one pair and find those of its maps; runs inside a worker.

    Returns
    -------
    dict
        ``rotations`` (m, 3, 3), ``maps`` (m, k), ``evidence`` (m, 7), the best candidate first.
    """
    samples = [samples_from_record(shared[key], key) for key in (task.target_key, task.source_key)]
    surfaces = [surface_from_record(shared[key], key) for key in (task.target_surface, task.source_surface)]
    weigher = PoseWeigher(samples[0], samples[1], PoseMapper(surfaces[0], surfaces[1]))
    starts = task.starts
    if task.with_axes:
        starts = np.concatenate([starts, axis_poses(surfaces[0], surfaces[1], mirrored=task.group == "O")])
    found = distinct([weigher.candidate_from(start) for start in starts])
    return {
        "rotations": np.stack([candidate.rotation for candidate in found]),
        "maps": np.stack([candidate.point_map for candidate in found]).astype(np.int32),
        "evidence": np.stack([candidate.evidence for candidate in found]),
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedPose:
    """A pose that a map asks for, with all that is known about both.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
    point_map : ndarray of int, shape (k,)
        The samples' best one-to-one match there.
    evidence : ndarray, shape (7,)
        As :data:`collalign.stages.evidence.odds.EVIDENCE` names it.
    """

    rotation: FloatArray
    point_map: IntArray
    evidence: FloatArray

    @property
    def score(self) -> float:
        """Log-odds up to a constant of the pair."""
        return float(evidence_score(self.evidence[None])[0])


class PoseWeigher:
    """Weighs poses of one pair.

    Parameters
    ----------
    target, source : Samples
    mapper : PoseMapper
        Of their surfaces.
    """

    def __init__(self, target: Samples, source: Samples, mapper: PoseMapper) -> None:
        self._target, self._source, self._mapper = target, source, mapper
        self._fixed_costs = cdist(source.invariants, target.invariants, "sqeuclidean")

    def candidate_from(self, start: FloatArray) -> WeighedPose:
        """Return the pose of the map that a pose leads to, with its evidence."""
        return self.weigh(self._mapper.map_from(start), chirality=float(np.sign(np.linalg.det(start))))

    def weigh(self, found: FunctionalMap, *, chirality: float) -> WeighedPose:
        """Return the pose of determinant ``chirality`` that a map asks for, with the evidence of both."""
        rotation = self._mapper.rotation_of(found, chirality=chirality)
        of_map = self._mapper.evidence(found)
        point_map, energy = self._match_at(rotation)
        normals = self._mapper.matched(found, self._mapper.target.normals, self._mapper.source.normals @ rotation.T)
        evidence = {
            "energy": energy,
            "surface": self._surface_gap(rotation),
            "normals": float(1.0 - (normals[0] * normals[1]).sum(axis=1).mean()),
            "curvature": of_map.curvature,
            "commutativity": of_map.commutativity,
            "roughness": of_map.roughness,
            "orientation": chirality * of_map.orientation,
        }
        return WeighedPose(
            rotation=rotation, point_map=point_map, evidence=np.array([evidence[kind] for kind in EVIDENCE])
        )

    def _match_at(self, rotation: FloatArray) -> tuple[IntArray, float]:
        costs = cdist(self._source.positions @ rotation.T, self._target.positions, "sqeuclidean") + self._fixed_costs
        rows, columns = linear_sum_assignment(costs)
        return columns.astype(np.int64), float(costs[rows, columns].sum())

    def _surface_gap(self, rotation: FloatArray) -> float:
        """Return the mean squared distance of closest points and normals, both ways."""
        target, source = self._mapper.target, self._mapper.source
        fixed = np.hstack([target.points, SURFACE_NORMAL_WEIGHT * target.normals])
        moved = np.hstack([source.points @ rotation.T, SURFACE_NORMAL_WEIGHT * source.normals @ rotation.T])
        there, back = mutual_nearest_rows(fixed, moved)
        gaps = np.concatenate([fixed[there] - moved, fixed - moved[back]])
        return float((gaps**2).sum(axis=1).mean())


def distinct(candidates: Sequence[WeighedPose]) -> list[WeighedPose]:
    """Return the candidates that most speaks for, best first, of each set of nearly equal rotations only one."""
    kept: list[WeighedPose] = []
    for candidate in sorted(candidates, key=lambda c: -c.score):
        known = np.array([other.rotation for other in kept]).reshape(-1, 3, 3)
        angles = rotation_angle_deg(known, np.tile(candidate.rotation, (len(known), 1, 1)))
        if not (np.asarray(angles) <= SAME_CANDIDATE_DEG).any():
            kept.append(candidate)
    return kept[:MAX_CANDIDATES]


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
    records = weigh_starts(session, shapes, pairs, own, with_axes=True)
    weighed = [by_energy(pair) for pair in pairs]
    for e, record in records.items():
        weighed[e] = with_evidence(pairs[e], record, shapes.label(pairs[e].target, pairs[e].source))
    return weighed


def weigh_starts(
    session: AlignSession, shapes: Shapes, pairs: Sequence[Pair], starts: Mapping[int, FloatArray], *, with_axes: bool
) -> dict[int, Record]:
    """Return what maps of some pairs make of some poses, by position of the pair, as :func:`weigh_pair` does.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    pairs : sequence of Pair
    starts : mapping of int to ndarray (m, 3, 3)
        Poses of each pair that is to be weighed; pairs without surfaces are left out.
    with_axes : bool
        Start from the pairings of the principal axes as well.
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
                with_axes=with_axes,
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
    try:
        evidence = as_floats(record["evidence"], "evidence", shape=(None, len(EVIDENCE)))
        num = len(evidence)
        poses = as_rotations(as_floats(record["rotations"], "rotations", shape=(num, 3, 3)), "rotations")
        maps = as_indices(record["maps"], "maps", upper=num_samples, shape=(num, num_samples))
        if not num:
            raise InputError("holds no pose")
    except KeyError as error:
        raise StoreError(f"stored evidence of {label}: {error} is missing") from None
    except (InputError, TypeError, ValueError) as error:
        raise StoreError(f"stored evidence of {label}: {error}") from None
    return [
        WeighedPose(rotation=pose, point_map=point_map, evidence=row)
        for pose, point_map, row in zip(poses, maps, evidence, strict=True)
    ]


def _key(task: EvidenceTask) -> str:
    settings = {"group": task.group, "starts": task.starts.tolist(), "with_axes": task.with_axes}
    return fingerprint(EVIDENCE_VERSION, settings, task.target_surface, task.source_surface)
