"""Proofs for the pairs that matter: those with competing poses, and those that synchronization rejects.

Branch and bound over the rotations (:mod:`pairwise.branch_and_bound.prove`) either proves the best pose of a pair,
or the pose that was overlooked comes to light, or the time ends and the bound says how far the proof came. What a
proof finds within its time depends on the machine: runs with ``--certify`` are repeatable bit by bit only from their
store.

Every proof is written down as a certificate, which anybody can check without the prover.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from collalign.engine.job import Job, Wanted
from collalign.options import AlignOptions, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.match_pairs import pair_key
from collalign.stages.poses.agreement import SAME_POSE_RAD
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.stages.shape_stage import SAMPLING
from collalign.synchronization import SynchronizationResult
from collalign.whole_pairs.local_evidence import local_evidence
from collalign.whole_pairs.problem import pair_problem
from data_tools.arrays import BoolArray, FloatArray, Holds, IntArray
from data_tools.embedding.embedding import Samples
from data_tools.notes import Note
from data_tools.poses import APART_DEG
from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.pose_lists import PoseList, list_poses
from pairwise.certificates.certificate import Certificate
from pairwise.matching import GAP_TOL
from pairwise.results import Status

#: A second pose within this factor of the best energy makes a pair worth proving.
RIVAL_FACTOR = 1.25
#: All poses of at most this factor times the best energy are listed, which takes about half as long again.
LISTED_WITHIN = 1.2
#: A common pose farther than this from every pose that a pair can have contradicts the pair.
CONTRADICTION_RAD = np.deg2rad(APART_DEG)
#: A worker that takes so many times its time hangs, and is given up.
GIVEN_UP_FACTOR = 10
#: Most listed poses and regions of a pair: more candidates would make synchronization slow.
MOST_LISTED = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class PairProof:
    """What was proven of a pair: its best pose with a bound, and the ``listed`` poses that are nearly as good.

    Fields of the same names are those of :class:`collalign.products.pair.Pair`; where there is a certificate, the
    bound is what that proves.
    """

    lower_bound: float
    status: Status
    energy: float
    rotation: Annotated[FloatArray, Holds(shape="d d", rotations=True)]
    map: Annotated[IntArray, Holds(shape="k")]
    mismatch: Annotated[float, Holds(nan=True)]
    chirality_proven: bool
    certificate: Certificate | None
    listed_energies: Annotated[FloatArray, Holds(shape="m")]
    listed_rotations: Annotated[FloatArray, Holds(shape="m d d", rotations=True)]
    listed_maps: Annotated[IntArray, Holds(shape="m k", lower=-1)]
    listed_mismatches: Annotated[FloatArray, Holds(shape="m", nan=True)]
    complete_within: Annotated[float, Holds(nan=True)]
    regions: Annotated[FloatArray, Holds(shape="r d d", rotations=True)]
    region_radii_rad: Annotated[FloatArray, Holds(shape="r")]


def proofs_note(former: Sequence[Pair], proven: Sequence[Pair], num_wanted: int) -> Note:
    """Return what proofs of pairs came to: these before and after, of so many that were worth one."""
    complete = [pair for pair in proven if not np.isnan(pair.complete_within)]
    numbers = {
        "num_optimal": sum(pair.status == Status.PROVEN_OPTIMAL.name for pair in proven),
        "num_tried": len(proven),
        "num_wanted": num_wanted,
        "num_chirality": sum(bool(pair.chirality_proven) for pair in proven),
        "num_improved": sum(
            bool(new.energies[0] < old.energies[0]) for old, new in zip(former, proven, strict=True)
        ),
        "num_complete": len(complete),
        "num_unique": sum(len(pair.regions) == 1 for pair in complete),
    }
    return Note("pairs-proven", values={**numbers, "within": LISTED_WITHIN})


def prove_pair(
    target: Samples,
    source: Samples,
    group: str,
    rotations: FloatArray,
    gap_tol: float,
    time_limit_s: float,
) -> PairProof:
    """Prove the best pose of one pair and list its alternatives, from rotations (m, 3, 3); runs inside a worker."""
    problem = pair_problem(target, source, group)
    poses = list_poses(
        problem,
        rotations,
        within=LISTED_WITHIN,
        tol=gap_tol,
        time_limit_s=time_limit_s,
        record=True,
    )
    return pair_proof(poses, lambda rotations: local_evidence(target, source, rotations)[0])


def pair_proof(poses: PoseList, mismatches_at: Callable[[FloatArray], FloatArray]) -> PairProof:
    """Return what was proven: at most :data:`MOST_LISTED` poses, (m, 3, 3), with balls if the list is complete."""
    proof = poses.proof
    pose, certificate = proof.candidate, proof.certificate
    shape, size = pose.R_target_source.shape, len(pose.map_target_source)
    is_complete = poses.is_resolved and len(poses.regions) <= MOST_LISTED
    nearly = poses.candidates[:MOST_LISTED]
    balls = [region.ball for region in poses.regions] if is_complete else []
    rotations = np.array([one.R_target_source for one in nearly]).reshape(-1, *shape)
    return PairProof(
        lower_bound=float(
            min(proof.lower_bound if certificate is None else certificate.bound, pose.energy)
        ),
        status=proof.status,
        energy=float(pose.energy),
        rotation=pose.R_target_source,
        map=pose.map_target_source.astype(np.int32),
        mismatch=float(mismatches_at(pose.R_target_source[None])[0]),
        chirality_proven=bool(proof.is_chirality_proven),
        certificate=certificate,
        listed_energies=np.array([one.energy for one in nearly], dtype=np.float64),
        listed_rotations=rotations,
        listed_maps=np.array([one.map_target_source for one in nearly])
        .reshape(-1, size)
        .astype(np.int32),
        listed_mismatches=mismatches_at(rotations),
        complete_within=LISTED_WITHIN if is_complete else float("nan"),
        regions=np.array([centre for centre, _ in balls]).reshape(-1, *shape),
        region_radii_rad=np.array([radius for _, radius in balls], dtype=np.float64),
    )


#: Proves a pair. The version changes whenever the same pair would give another proof.
PROVING = Job(kind="proofs", version="proof-6", run=prove_pair, reader=PairProof)


def certify_pairs(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    solution: SynchronizationResult | None,
) -> tuple[list[Pair], SynchronizationResult | None, Note]:
    """Prove the pairs that matter, the least settled first, within ``options.certify_budget_s``.

    Parameters
    ----------
    session : Session
    shapes : Shapes
    pairs : sequence of Pair
    solution : SynchronizationResult or None
        Of these pairs, which says which of them are trusted; None to synchronize them.

    Returns
    -------
    pairs : list of Pair
        With bounds and with all poses of nearly the best energy among the candidates.
    solution : SynchronizationResult or None
        Of the returned pairs; None where a new pose changed them.
    note : Note
        What was proven.

    Raises
    ------
    InputError
        With ``options.strict``, at the first proof that fails.
    """
    options = session.options
    solution = solution or synchronize_pairs(options, len(shapes.names), pairs)
    wanted = worth_proving(pairs, solution.edge_inlier)
    affordable = max(
        1, int(options.certify_budget_s * session.run.num_workers / options.certify_pair_s)
    )
    found = session.compute(
        PROVING,
        {e: _wanted(shapes, pairs[e], options) for e in wanted[:affordable]},
        time_limit_s=GIVEN_UP_FACTOR * options.certify_pair_s,
        strict=options.strict,
    )
    proven, tried = list(pairs), list(found)
    for e, proof in found.items():
        proven[e] = with_proof(pairs[e], proof)
    note = proofs_note([pairs[e] for e in tried], [proven[e] for e in tried], len(wanted))
    is_changed = any(len(proven[e].energies) > len(pairs[e].energies) for e in tried)
    return proven, None if is_changed else solution, note


def worth_proving(pairs: Sequence[Pair], inlier: BoolArray) -> list[int]:
    """Return the pairs that are worth a proof: rejected ones first, then by how close the second pose comes.

    Parameters
    ----------
    pairs : sequence of Pair
    inlier : ndarray of bool, shape (E,)
        Whether synchronization trusts each pair.
    """
    tiny = np.finfo(float).tiny
    ratios = np.array(
        [
            pair.energies[1] / max(pair.energies[0], tiny) if len(pair.energies) > 1 else np.inf
            for pair in pairs
        ]
    )
    order = np.lexsort((ratios, inlier))
    return [int(e) for e in order if not inlier[e] or ratios[e] <= RIVAL_FACTOR]


def with_proof(pair: Pair, proof: PairProof) -> Pair:
    """Return the pair with the proof's bound and status, and with its poses among the candidates, best first."""
    pair = replace(
        pair,
        lower_bound=proof.lower_bound,
        status=proof.status.name,
        chirality_proven=proof.chirality_proven,
        certificate=proof.certificate,
        complete_within=proof.complete_within,
        regions=proof.regions,
        region_radii_rad=proof.region_radii_rad,
    )
    rotations = np.concatenate([proof.rotation[None], proof.listed_rotations])
    maps = np.concatenate([proof.map[None], proof.listed_maps])
    energies = np.concatenate([[proof.energy], proof.listed_energies])
    mismatches = np.concatenate([[proof.mismatch], proof.listed_mismatches])
    for pose in np.argsort(energies, kind="stable"):
        near = rotation_angles(pair.rotations, rotations[pose]) <= SAME_POSE_RAD
        if near.any() and energies[pose] >= pair.energies[near].min() * (1 - 1e-6):
            continue
        rank, known = int(np.searchsorted(pair.energies, energies[pose])), pair.mismatches
        pair = replace(
            pair,
            rotations=np.insert(pair.rotations, rank, rotations[pose], axis=0),
            maps=np.insert(pair.maps, rank, maps[pose], axis=0),
            energies=np.insert(pair.energies, rank, energies[pose]),
            mismatches=np.insert(known, rank, mismatches[pose]) if len(known) else known,
        )
    return pair


def contradictions(
    names: Sequence[str], pairs: Sequence[Pair], frames: FloatArray
) -> tuple[Note, ...]:
    """Return the note that names the pairs whose complete lists hold no pose near the common poses, if any.

    Parameters
    ----------
    names : sequence of str
    pairs : sequence of Pair
    frames : ndarray, shape (N, 3, 3)
        ``R_common_shape``.
    """
    found = []
    for pair in pairs:
        apart = rotation_angles(pair.regions, frames[pair.target].T @ frames[pair.source])
        if (
            not np.isnan(pair.complete_within)
            and (apart - pair.region_radii_rad > CONTRADICTION_RAD).all()
        ):
            found.append(f"{names[pair.target]} - {names[pair.source]}")
    if not found:
        return ()
    numbers = {"within": LISTED_WITHIN, "apart_deg": float(np.rad2deg(CONTRADICTION_RAD))}
    return (Note("proofs-contradict", values={"pairs": tuple(found), **numbers}),)


def _wanted(shapes: Shapes, pair: Pair, options: AlignOptions) -> Wanted:
    ends = shapes.keys[pair.target], shapes.keys[pair.source]
    settings = {
        "tol": GAP_TOL,
        "time_limit_s": options.certify_pair_s,
        "rotations": pair.rotations.tolist(),
    }
    return Wanted(
        key=PROVING.key(settings, pair_key(*ends, options)),
        label=shapes.label(pair.target, pair.source),
        arguments={
            "target": SAMPLING.shared(ends[0]),
            "source": SAMPLING.shared(ends[1]),
            "group": options.group,
            "rotations": pair.rotations,
            "gap_tol": GAP_TOL,
            "time_limit_s": options.certify_pair_s,
        },
    )
