"""Proofs for the pairs that matter: those with rival poses, and those that synchronization rejects.

Branch and bound over the rotations (:mod:`pairwise.branch_and_bound.prove`) either proves the best pose of a pair,
or the pose that was overlooked comes to light, or the time ends and the bound says how far the proof came. What a
proof finds within its time depends on the machine: runs with ``--certify`` are repeatable bit by bit only from their
store.

Every proof is written down as a certificate, which anybody can check without the prover.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.engine.jobs.run import SharedTable
from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import Record
from collalign.options import AlignOptions, AlignSession
from collalign.products.matching_input import pair_problem
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.pairs.match import pair_key
from collalign.stages.poses.synchronize import synchronize_pairs
from collalign.stages.stored_types import proof_from_record, proof_to_record, samples_from_record
from collalign.stages.surface_gap import surface_gaps
from collalign.synchronization import SynchronizationResult
from collalign.synchronization.resolve import SAME_POSE_RAD
from data_tools.arrays import BoolArray, FloatArray
from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.poses import list_poses
from pairwise.status import Status

#: Changes whenever the same pair would give another proof.
PROOF_VERSION = "proof-4"
#: Relative gap between energy and bound at which a pose counts as proven.
GAP_TOL = 1e-3
#: A second pose within this factor of the best energy makes a pair worth proving.
RIVAL_FACTOR = 1.25
#: All poses of at most this factor times the best energy are listed, which takes about half as long again.
LISTED_WITHIN = 1.2
#: A common pose farther than this from every pose that a pair can have contradicts the pair.
CONTRADICTION_RAD = np.deg2rad(30.0)
#: A worker that takes so many times its time hangs, and is given up.
GIVEN_UP_FACTOR = 10
#: Pairs named in a note.
_MOST_NAMED = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofTask:
    """What a worker needs to prove one pair's best pose."""

    target_key: str
    source_key: str
    group: str
    rotations: FloatArray
    gap_tol: float
    time_limit_s: float


@dataclass(frozen=True, kw_only=True)
class CertificationReport:
    """What was proven.

    Attributes
    ----------
    num_wanted : int
        Pairs worth proving.
    num_tried : int
        As many as the budget allowed.
    num_proven : int
        Pairs whose best pose is proven.
    num_chiralities : int
        Pairs whose mirror decision is proven.
    num_improved : int
        Pairs for which the proof found a better pose.
    num_complete : int
        Pairs whose poses of nearly the best energy are listed completely.
    num_alone : int
        Of these, pairs with no second such pose.
    """

    num_wanted: int
    num_tried: int
    num_proven: int
    num_chiralities: int
    num_improved: int
    num_complete: int
    num_alone: int

    def __str__(self) -> str:
        text = f"{self.num_proven} of {self.num_tried} pairs proven optimal"
        if self.num_tried < self.num_wanted:
            text += f" ({self.num_wanted} were worth proving, the budget ended)"
        if self.num_chiralities:
            text += f", {self.num_chiralities} mirror decisions proven"
        if self.num_improved:
            text += f", {self.num_improved} better poses found"
        return (
            f"{text}; of {self.num_complete} all poses within {LISTED_WITHIN - 1:.0%} of the best energy are known, "
            f"{self.num_alone} have no second one."
        )


def prove_pair(task: ProofTask, shared: SharedTable) -> Record:
    """Prove the best pose of one pair and list its rivals as far as the time allows; runs inside a worker."""
    target, source = (shared.made(key, samples_from_record) for key in (task.target_key, task.source_key))
    problem = pair_problem(target, source, task.group)
    poses = list_poses(
        problem,
        task.rotations,
        within=LISTED_WITHIN,
        tol=task.gap_tol,
        time_limit_s=task.time_limit_s,
        record=True,
    )
    record = proof_to_record(poses, LISTED_WITHIN)
    return record | {
        "gap": float(surface_gaps(target, source, record["rotation"][None])[0]),
        "listed_gaps": surface_gaps(target, source, record["listed_rotations"]),
    }


def certify_pairs(
    session: AlignSession, shapes: Shapes, pairs: Sequence[Pair], solution: SynchronizationResult | None
) -> tuple[list[Pair], SynchronizationResult | None, CertificationReport]:
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
    report : CertificationReport

    Raises
    ------
    InputError
        With ``options.strict``, at the first proof that fails.
    """
    options = session.options
    solution = solution or synchronize_pairs(options, len(shapes.names), pairs)
    wanted = worth_proving(pairs, solution.edge_inlier)
    affordable = max(1, int(options.certify_budget_s * session.run.num_workers / options.certify_pair_s))
    keys = {e: _proof_key(shapes, pairs[e], options) for e in wanted[:affordable]}
    with session.shared_table(
        "shapes", (shapes.keys[end] for e in keys for end in (pairs[e].target, pairs[e].source))
    ) as table:
        failures = session.compute(
            "proofs",
            prove_pair,
            {key: (_label(shapes, pairs[e]), _task(shapes, pairs[e], options)) for e, key in keys.items()},
            time_limit_s=GIVEN_UP_FACTOR * options.certify_pair_s,
            strict=options.strict,
            shared=table,
        )
    proven, tried = list(pairs), [e for e, key in keys.items() if key not in failures]
    for e in tried:
        record = session.store.require("proofs", keys[e])
        proven[e] = with_proof(pairs[e], proof_from_record(record, _label(shapes, pairs[e])))
    report = CertificationReport(
        num_wanted=len(wanted),
        num_tried=len(tried),
        num_proven=sum(proven[e].status == Status.PROVEN_OPTIMAL.name for e in tried),
        num_chiralities=sum(proven[e].chirality_proven for e in tried),
        num_improved=sum(proven[e].energies[0] < pairs[e].energies[0] for e in tried),
        num_complete=sum(not np.isnan(proven[e].complete_within) for e in tried),
        num_alone=sum(len(proven[e].regions) == 1 for e in tried if not np.isnan(proven[e].complete_within)),
    )
    is_changed = any(len(proven[e].energies) > len(pairs[e].energies) for e in tried)
    return proven, None if is_changed else solution, report


def worth_proving(pairs: Sequence[Pair], inlier: BoolArray) -> list[int]:
    """Return the pairs that are worth a proof: rejected ones first, then by how close the second pose comes.

    Parameters
    ----------
    pairs : sequence of Pair
    inlier : ndarray of bool, shape (E,)
        Whether synchronization trusts each pair.
    """
    tiny = np.finfo(float).tiny
    rivals = np.array(
        [pair.energies[1] / max(pair.energies[0], tiny) if len(pair.energies) > 1 else np.inf for pair in pairs]
    )
    order = np.lexsort((rivals, inlier))
    return [int(e) for e in order if not inlier[e] or rivals[e] <= RIVAL_FACTOR]


def with_proof(pair: Pair, proof: Record) -> Pair:
    """Return the pair with the proof's bound and status, and with its poses among the candidates, best first."""
    pair = replace(
        pair,
        lower_bound=float(proof["lower_bound"]),
        status=str(proof["status"]),
        chirality_proven=bool(proof["chirality_proven"]),
        certificate=proof["certificate"],
        complete_within=float(proof["complete_within"]),
        regions=proof["regions"],
        region_radii_rad=proof["region_radii_rad"],
    )
    rotations = np.concatenate([proof["rotation"][None], proof["listed_rotations"]])
    maps = np.concatenate([proof["map"][None], proof["listed_maps"]])
    energies = np.concatenate([[proof["energy"]], proof["listed_energies"]])
    gaps = np.concatenate([[proof["gap"]], proof["listed_gaps"]])
    for pose in np.argsort(energies, kind="stable"):
        near = rotation_angles(pair.rotations, rotations[pose]) <= SAME_POSE_RAD
        if near.any() and energies[pose] >= pair.energies[near].min() * (1 - 1e-6):
            continue
        rank = int(np.searchsorted(pair.energies, energies[pose]))
        pair = replace(
            pair,
            rotations=np.insert(pair.rotations, rank, rotations[pose], axis=0),
            maps=np.insert(pair.maps, rank, maps[pose], axis=0),
            energies=np.insert(pair.energies, rank, energies[pose]),
            gaps=np.insert(pair.gaps, rank, gaps[pose]) if len(pair.gaps) else pair.gaps,
        )
    return pair


def contradictions(names: Sequence[str], pairs: Sequence[Pair], frames: FloatArray) -> tuple[str, ...]:
    """Return the sentence that names the pairs whose complete lists hold no pose near the common poses, if any.

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
        if not np.isnan(pair.complete_within) and (apart - pair.region_radii_rad > CONTRADICTION_RAD).all():
            found.append(f"{names[pair.target]} - {names[pair.source]}")
    if not found:
        return ()
    shown = ", ".join(found[:_MOST_NAMED]) + (f" and {len(found) - _MOST_NAMED} more" if found[_MOST_NAMED:] else "")
    return (
        f"Proven: no pose of {shown} that costs at most {LISTED_WITHIN:g} times the best one is within "
        f"{np.rad2deg(CONTRADICTION_RAD):.0f} deg of the common poses.",
    )


def _label(shapes: Shapes, pair: Pair) -> str:
    return shapes.label(pair.target, pair.source)


def _proof_key(shapes: Shapes, pair: Pair, options: AlignOptions) -> str:
    settings = {"tol": GAP_TOL, "time_limit_s": options.certify_pair_s}
    key = pair_key(shapes.keys[pair.target], shapes.keys[pair.source], options)
    return fingerprint(PROOF_VERSION, settings, key)


def _task(shapes: Shapes, pair: Pair, options: AlignOptions) -> ProofTask:
    return ProofTask(
        target_key=shapes.keys[pair.target],
        source_key=shapes.keys[pair.source],
        group=options.group,
        rotations=pair.rotations,
        gap_tol=GAP_TOL,
        time_limit_s=options.certify_pair_s,
    )
