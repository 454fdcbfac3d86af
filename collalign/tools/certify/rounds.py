"""Rounds of multipliers and proofs: a lower bound for all consistent arrangements of some shapes together.

Multipliers (:mod:`collalign.tools.certify.multipliers`) are improved by descents, which cost little, before all pairs
are bounded at them by branch and bound, for as long as there is time. Any multipliers prove a bound, and so do any of
the pairs; the best of all rounds counts. Rounding the relaxed Gram matrix also leads to arrangements that may be
cheaper than any known one.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from collalign.engine.jobs.job import Job, Wanted
from collalign.options import AlignSession
from collalign.tools.certify.arrangement import PairEnergies
from collalign.tools.certify.multipliers import JointMaster
from collalign.tools.certify.result import JointBound
from data_tools.arrays import FloatArray, read_only
from pairwise.branch_and_bound.tilted import TiltedProof, least_energies, prove_tilted
from pairwise.certificates.verify_joint import gram_bound
from pairwise.local.rotation_sets import rotation_set
from pairwise.problem.problem import Problem

#: How exactly each pair is bounded, as a share of the mean energy of a pair: what the joint bound loses to it.
_GAP = 5e-4
#: Rounds of descents before each round of proofs, which takes about three times as long as one of them: pairs times
#: rounds, and most.
_DESCENT_PAIRS, _MOST_DESCENTS = 10_000, 5
#: Rounds of proofs of all pairs at most. They end once this share of the cheapest known energy is proven, or the
#: columns promise no more than this share above what is.
_MOST_ROUNDS, _ENOUGH, _SETTLED = 3, 0.999, 1e-3
#: The multipliers are made again for an arrangement that is cheaper by this share.
_CHEAPER = 1e-3
#: Columns kept of each search.
_NUM_KEPT = 8
#: What each descent starts from beside the columns in use: turns of the best pose, and some of so many rotations.
_NUM_JITTERED, _JITTER_RAD, _NUM_FAR, _NUM_STARTS = 4, 0.1, 6, 16
#: Smallest energy, as a share of a shape's square size, that tolerances are taken of.
_LEAST_ENERGY = 1e-6
#: Descents from perturbed arrangements: pairs times descents, and most.
_PERTURBED_PAIRS, _MOST_PERTURBED = 6000, 200
#: Relative rounding of what a linear function of a rotation is at most.
_ROUNDING = 128.0 * float(np.finfo(np.float64).eps)


#: The samples of a shape as they are matched: coordinates (k, 3) and invariants (k, m).
Points: TypeAlias = tuple[FloatArray, FloatArray]


def bound_pair(target: Points, source: Points, group: str, **settings: Any) -> TiltedProof:
    """Bound a pair's energy less a linear function of its rotation, see :func:`prove_tilted`; in a worker."""
    return prove_tilted(problem_of(target, source, group), **settings)


#: Bounds a pair. The version changes whenever the same pair and multipliers would give another bound.
BOUNDING = Job(kind="proofs", version="joint-5", run=bound_pair, reader=TiltedProof)


def problem_of(target: Points, source: Points, group: str) -> Problem:
    """Return the matching problem of two shapes."""
    return Problem.from_user(target[0], source[0], group=group, invariants=(target[1], source[1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Rounds:
    """The samples of shapes, their keys, the pairs' energies and known poses (m, 3, 3), and who computes."""

    session: AlignSession
    samples: Sequence[Points]
    keys: Sequence[str]
    energies: PairEnergies
    candidates: Sequence[FloatArray]

    def descend(self, tilts: FloatArray, known: Sequence[FloatArray]) -> list[TiltedProof]:
        """Descend to small values of every pair at tilts (E, 3, 3), from known rotations."""
        group = {"group": self.session.options.group, "gap": 0.0}
        tasks = {e: self._shapes(e) | group | {"tilt": tilts[e], "known": some} for e, some in enumerate(known)}
        return list(self.session.map_parallel("descents", bound_pair, tasks).values())

    def prove(self, master: JointMaster, gap: float, deadline: float) -> list[TiltedProof]:
        """Bound every pair at the master's tilts to a gap, first those whose bounds raise the joint one most.

        A pair whose energy is high needs fewer cells as well. What is proven goes to the store. Pairs that failed, or
        that no time is left for, have bounds that cost nothing: energies are not negative.
        """
        most = np.linalg.norm(master.tilts, "nuc", axis=(1, 2)) * (1.0 + _ROUNDING)
        wanted, group = {}, self.session.options.group
        for e in np.argsort(-(master.least() + most), kind="stable").tolist():
            i, j = self.energies.edges[e].tolist()
            settings = {"group": group, "tilt": master.tilts[e], "known": master.used(e), "gap": gap}
            wanted[e] = Wanted(
                key=BOUNDING.key(settings, self.keys[i], self.keys[j]),
                label=f"pair {i}, {j}",
                arguments=self._shapes(e) | settings | {"time_limit_s": self.session.run.pair_time_limit_s},
            )
        found = self.session.compute(BOUNDING, wanted, time_limit_s=None, until=deadline)
        sides = 2 if group == "O" else 1
        return [found[e] if e in found else unproven(-bound, sides) for e, bound in enumerate(most.tolist())]

    def _shapes(self, pair: int) -> dict[str, Any]:
        i, j = self.energies.edges[pair]
        return {"target": self.samples[i], "source": self.samples[j]}


def unproven(bound: float, sides: int) -> TiltedProof:
    """Return a bound that is proven by the whole of the rotations, of so many chiralities, as one cell per face."""
    nothing = np.zeros((0, 3, 3))
    return TiltedProof(
        lower_bound=bound,
        rotations=nothing,
        energies=nothing[:, 0, 0],
        depths=np.zeros(4 * sides, dtype=np.int64),
        num_cells=np.full(sides, 4),
    )


def bound_arrangements(rounds: Rounds, frames: FloatArray, budget_s: float) -> JointBound:
    """Bound the energy of every arrangement of the shapes from below, and seek a cheaper one than the given.

    Parameters
    ----------
    rounds : Rounds
        Its session's group is decided, "SO" or "O".
    frames : ndarray, shape (N, 3, 3)
        ``R_common_shape`` of the arrangement that is to be judged.
    budget_s : float
        Seconds after which no further proof of a pair begins.
    """
    deadline, energies = time.monotonic() + budget_s, rounds.energies
    edges, rng = energies.edges, np.random.default_rng(0)
    near = energies.descend(frames)
    num = min(_PERTURBED_PAIRS // len(edges), _MOST_PERTURBED)
    best, energy = energies.perturb(near, np.random.default_rng(0), num)
    unit = _unit(energies, energy)
    master = JointMaster(energies.num_shapes, edges, energies.relative(best), energies.at(best), unit)
    for pair, (problem, some) in enumerate(zip(energies.problems, rounds.candidates, strict=True)):
        master.add(pair, some, least_energies(problem, some))
    bounds: list[float] = []
    proven: dict[str, NDArray[Any]] = {}
    ended = ""
    while not ended:
        began, promised = time.monotonic(), np.inf
        if not master.is_large:
            promised = _descend(rounds, master, best, rng, deadline)
            found, former = energies.descend(energies.rounded(master.gram)), energy
            best, energy = min((best, energy), found, key=lambda one: one[1])
            unit, rotations, values = _unit(energies, energy), energies.relative(best), energies.at(best)
            for pair in range(len(edges)):
                master.add(pair, rotations[pair : pair + 1], values[pair : pair + 1])
            if energy < (1.0 - _CHEAPER) * former:
                continue
        proofs = rounds.prove(master, _GAP * unit, deadline)
        _add(master, proofs)
        bounds.append(sum(proof.lower_bound for proof in proofs) + gram_bound(edges, master.tilts, master.diagonal))
        if bounds[-1] == max(bounds):
            proven = {
                "tilts": master.tilts,
                "diagonal": master.diagonal,
                "depths": np.concatenate([proof.depths for proof in proofs]).astype(np.uint8),
                "num_cells": np.stack([proof.num_cells for proof in proofs]),
            }
        next_end = 2.0 * time.monotonic() - began
        ended = _ended(bounds, promised, energy, master.is_large, next_end > deadline)
    return JointBound(
        edges=read_only(edges),
        stated_energy=float(energies.at(frames).sum()),
        near_energy=near[1],
        energy=energy,
        frames=read_only(best),
        bounds=tuple(bounds),
        ended=ended,
        bound=max(0.0, *bounds),
        proof=proven,
    )


def _descend(
    rounds: Rounds, master: JointMaster, best: FloatArray, rng: np.random.Generator, deadline: float
) -> float:
    """Improve the multipliers by rounds of descents; return what the columns promise.

    Pairs descend from columns with a share, turns of the best pose by a few degrees and some of all rotations.
    """
    starts = rotation_set(3, _NUM_STARTS)
    starts = np.concatenate([starts, -starts]) if rounds.session.options.group == "O" else starts
    relative = rounds.energies.relative(best)
    promised = master.run()
    for _ in range(int(np.clip(_DESCENT_PAIRS // len(relative), 1, _MOST_DESCENTS))):
        if time.monotonic() >= deadline:
            break
        turns = Rotation.from_rotvec(_JITTER_RAD * rng.standard_normal((_NUM_JITTERED, 3))).as_matrix()
        far = starts[rng.choice(len(starts), _NUM_FAR)]
        known = [np.concatenate([master.used(e), one @ turns, far]) for e, one in enumerate(relative)]
        _add(master, rounds.descend(master.tilts, known))
        promised = master.run()
    return promised


def _unit(energies: PairEnergies, best: float) -> float:
    """Return the mean energy of a pair, which tolerances are shares of."""
    return max(best / len(energies.edges), _LEAST_ENERGY * float((energies.problems[0].target ** 2).sum()))


def _add(master: JointMaster, found: Sequence[TiltedProof]) -> None:
    """Make columns of what was found, the least of each pair."""
    for e, proof in enumerate(found):
        master.add(e, proof.rotations[:_NUM_KEPT], proof.energies[:_NUM_KEPT])


def _ended(bounds: Sequence[float], promised: float, energy: float, is_large: bool, is_late: bool) -> str:
    """Return why no further round begins, empty if one does."""
    if max(bounds) >= _ENOUGH * energy:
        return "enough is proven"
    if is_large:
        return "the shapes are too many for multipliers, so the bounds of all pairs are added"
    if promised - max(bounds) <= _SETTLED * energy:
        return "the bound no longer rises"
    if len(bounds) >= _MOST_ROUNDS:
        return "the rounds ended"
    return "there was no time for another round" if is_late else ""
