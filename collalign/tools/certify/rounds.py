"""Rounds of multipliers and proofs: a lower bound for all consistent arrangements of some shapes together.

Multipliers (:mod:`collalign.tools.certify.multipliers`) are improved by descents, which cost little, before all pairs
are bounded at them by branch and bound. Any multipliers prove a bound; the best of all rounds counts. Rounding the
relaxed Gram matrix also leads to arrangements that may be cheaper than any known one.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from collalign.engine.jobs.job import Job, Wanted
from collalign.options import AlignSession
from collalign.tools.certify.arrangement import Arrangement, PairEnergies
from collalign.tools.certify.multipliers import JointMaster
from collalign.tools.certify.result import JointBound
from data_tools.arrays import FloatArray, read_only
from data_tools.checks import check_count, check_number
from data_tools.errors import CollectionError
from pairwise.branch_and_bound.tilted import TiltedProof, prove_tilted
from pairwise.certificates.verify_joint import gram_bound, largest_turns
from pairwise.local.rotation_sets import rotation_set
from pairwise.problem.problem import Problem

#: How exactly each pair is bounded, as a share of the mean energy of a pair: what the joint bound loses to it.
_GAP = 5e-4
#: Rounds of descents before each round of proofs, and when the rounds end: the columns promise no more than this
#: share of the energy above what is proven.
_DESCENTS, _SETTLED = 5, 1e-3
#: What is taken off per unit of 3 - <R*, R>, as a share of the mean energy of a pair, and the share of the energy
#: that the bound may lose to it, else nothing is: of 0, .003, .01, .03 and .1 the largest that eight teeth bear
#: (draws 0 to 4); eight chairs with near symmetries (family 10 of ``python -m experiments deformations``) lose 4 %.
_CURVATURE, _MOST_LOST = 0.03, 3e-3
#: An arrangement counts as cheaper, and the multipliers are made for it, from this share of a pair's energy on.
_CHEAPER = 1e-3
#: Rotations from which each pair's first columns descend beside its candidates, and columns kept of each search.
_NUM_STARTS, _NUM_KEPT = 16, 8
#: What each later descent starts from beside the columns in use: turns of the best pose, and some of all rotations.
_NUM_JITTERED, _JITTER_RAD, _NUM_FAR = 4, 0.1, 6
#: Smallest energy, as a share of a shape's square size, that tolerances are taken of.
_LEAST_ENERGY = 1e-6
#: Descents from perturbed arrangements: pairs times descents, and most.
_PERTURBED_PAIRS, _MOST_PERTURBED = 6000, 200


@dataclass(frozen=True, kw_only=True)
class CertifyOptions:
    """How far a certification goes.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    max_rounds: int = 3
    """Rounds of proofs of all pairs."""

    enough: float = 0.999
    """Stop once this share of the cheapest known arrangement's energy is proven."""

    budget_s: float = 3600.0
    """Seconds after which no further round begins."""

    def __post_init__(self) -> None:
        check_count("max_rounds", self.max_rounds, lower=1)
        check_number("enough", self.enough, upper=1.0, positive=True)
        check_number("budget_s", self.budget_s, positive=True)


#: The samples of a shape as they are matched: coordinates (k, 3) and invariants (k, m).
Points: TypeAlias = tuple[FloatArray, FloatArray]


def bound_pair(target: Points, source: Points, group: str, **settings: Any) -> TiltedProof:
    """Bound a pair's energy less a linear function of its rotation, see :func:`prove_tilted`; in a worker."""
    return prove_tilted(problem_of(target, source, group), **settings)


#: Bounds a pair. The version changes whenever the same pair and multipliers would give another bound.
BOUNDING = Job(kind="proofs", version="joint-3", run=bound_pair, reader=TiltedProof)


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

    def of_all(self, tilts: FloatArray, known: Sequence[FloatArray], gap: float = 0.0) -> list[TiltedProof]:
        """Bound every pair at tilts (E, 3, 3), or descend, from known rotations; what is proven goes to the store.

        Raises
        ------
        CollectionError
            If a proof failed.
        """
        wanted = {}
        for (i, j), tilt, some in zip(self.energies.edges.tolist(), tilts, known, strict=True):
            settings = {"group": self.session.options.group, "tilt": tilt, "known": some, "gap": gap}
            arguments = {"target": self.samples[i], "source": self.samples[j]} | settings
            wanted[i, j] = Wanted(
                key=BOUNDING.key(settings, self.keys[i], self.keys[j]),
                label=f"pair {i}, {j}",
                arguments=arguments | {"time_limit_s": self.session.run.pair_time_limit_s},
            )
        if not gap:
            tasks = {ends: one.arguments for ends, one in wanted.items()}
            return list(self.session.spread("descents", bound_pair, tasks).values())
        found = self.session.compute(BOUNDING, wanted, time_limit_s=None)
        for ends, reason in found.failures.items():
            raise CollectionError(f"{wanted[ends].label}: its energy could not be bounded ({reason})")
        return list(found.values())


def bound_arrangements(rounds: Rounds, frames: FloatArray, options: CertifyOptions) -> JointBound:
    """Bound the energy of every arrangement of the shapes from below, and seek a cheaper one than the given.

    Parameters
    ----------
    rounds : Rounds
        Its session's group is decided, "SO" or "O".
    frames : ndarray, shape (N, 3, 3)
        ``R_common_shape`` of the arrangement that is to be judged.
    options : CertifyOptions

    Raises
    ------
    CollectionError
        If the proof of a pair failed.
    """
    deadline, energies = time.monotonic() + options.budget_s, rounds.energies
    edges, rng = energies.edges, np.random.default_rng(0)
    near, gap = energies.descend(frames), 0.0
    num = int(np.clip(_PERTURBED_PAIRS // len(edges), 1, _MOST_PERTURBED))
    best = energies.perturb(near, np.random.default_rng(0), num)
    unit = _unit(energies, best)
    master = JointMaster(energies.num_shapes, edges, energies.relative(best.frames), energies.at(best.frames), unit)
    _descend(rounds, master, rng, first=True)
    proven: tuple[FloatArray, FloatArray, list[TiltedProof]] = master.tilts, master.diagonal, []
    bounds: list[float] = []
    ended = ""
    while not ended:
        promised = np.inf
        if not master.is_large:
            promised = _descend(rounds, master, rng)
            found = energies.descend(energies.rounded(master.gram))
            if found.energy < best.energy - _CHEAPER * unit:
                best, unit = found, _unit(energies, found)
                master.recentre(energies.relative(best.frames), energies.at(best.frames), _CURVATURE * unit)
                continue
            if not bounds:
                promised = _choose_curvature(rounds, master, rng, promised, unit)
        proofs = rounds.of_all(master.tilts, [master.used(e) for e in range(len(edges))], _GAP * unit)
        _add(master, proofs)
        pair_sum = sum(proof.lower_bound for proof in proofs)
        bounds.append(pair_sum + gram_bound(edges, master.tilts, master.diagonal))
        if bounds[-1] == max(bounds):
            proven, gap = (master.tilts, master.diagonal, proofs), best.energy - pair_sum
        ended = _ended(bounds, promised, best.energy, master.is_large, deadline, options)
    tilts, diagonal, proofs = proven
    return JointBound(
        edges=read_only(edges),
        stated_energy=float(energies.at(frames).sum()),
        near_energy=near.energy,
        energy=best.energy,
        frames=read_only(best.frames),
        bounds=tuple(bounds),
        ended=ended,
        bound=max(bounds),
        tilts=read_only(tilts),
        diagonal=read_only(diagonal),
        depths=read_only(np.concatenate([proof.depths for proof in proofs])),
        num_cells=read_only(np.stack([proof.num_cells for proof in proofs])),
        turns_rad=read_only(largest_turns(edges, tilts, diagonal, best.frames, gap)),
    )


def _descend(rounds: Rounds, master: JointMaster, rng: np.random.Generator, *, first: bool = False) -> float:
    """Improve the multipliers by rounds of descents; return what the columns promise.

    Pairs descend from columns with a share, turns of the best pose by a few degrees and some of all rotations; first
    without multipliers, from their candidates and all of these.
    """
    starts, promised = rotation_set(3, _NUM_STARTS), np.inf
    starts = np.concatenate([starts, -starts]) if rounds.session.options.group == "O" else starts
    if first:
        _add(master, rounds.of_all(master.tilts, [np.concatenate([some, starts]) for some in rounds.candidates]))
        return promised
    for _ in range(_DESCENTS):
        promised = master.run()
        turns = Rotation.from_rotvec(_JITTER_RAD * rng.standard_normal((_NUM_JITTERED, 3))).as_matrix()
        far = starts[rng.choice(len(starts), _NUM_FAR)]
        known = [np.concatenate([master.used(e), one @ turns, far]) for e, one in enumerate(master.known)]
        _add(master, rounds.of_all(master.tilts, known))
    return promised


def _choose_curvature(
    rounds: Rounds, master: JointMaster, rng: np.random.Generator, plain: float, unit: float
) -> float:
    """Take off what says how far poses can be from the best ones unless the bound falls; return what is promised."""
    master.curvature = _CURVATURE * unit
    promised = _descend(rounds, master, rng)
    if promised >= plain - _MOST_LOST * unit * len(master.known):
        return promised
    master.curvature = 0.0
    return _descend(rounds, master, rng)


def _unit(energies: PairEnergies, best: Arrangement) -> float:
    """Return the mean energy of a pair, which tolerances are shares of."""
    return max(best.energy / len(energies.edges), _LEAST_ENERGY * float((energies.problems[0].target ** 2).sum()))


def _add(master: JointMaster, found: Sequence[TiltedProof]) -> None:
    """Make columns of what was found, the least of each pair."""
    for e, proof in enumerate(found):
        master.add(e, proof.rotations[:_NUM_KEPT], proof.energies[:_NUM_KEPT])


def _ended(
    bounds: Sequence[float], promised: float, energy: float, is_large: bool, deadline: float, options: CertifyOptions
) -> str:
    """Return why no further round begins, empty if one does."""
    if max(bounds) >= options.enough * energy:
        return "enough is proven"
    if is_large:
        return "the shapes are too many for multipliers, so the bounds of all pairs are added"
    if promised - max(bounds) <= _SETTLED * energy:
        return "the bound no longer rises"
    if len(bounds) >= options.max_rounds:
        return "the rounds ended"
    return "the time ended" if time.monotonic() >= deadline else ""
