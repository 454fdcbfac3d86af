"""Multipliers and rounds of proofs: a lower bound for all consistent arrangements of some shapes together.

Multipliers are improved by descents, which cost little, before all pairs
are bounded at them by branch and bound, for as long as there is time. Any multipliers prove a bound, and so do any of
the pairs; the best of all rounds counts. Rounding the relaxed Gram matrix also leads to arrangements that may be
cheaper than any known one.

Good ones are the dual variables of: minimise ``sum_c shares_c F_ij(R_c)`` over G >= 0 with identity blocks and
``G_ij = sum_c shares_c R_c``, F_ij being replaced by its convex envelope over the rotations met so far (columns). It
is solved by alternating direction multipliers (Boyd et al. 2011): shares of each pair's columns, then the projection
on G >= 0, then the scaled dual U. There -rho U is positive semidefinite, has L_ij / 2 beside the diagonal and Y on
it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from collalign.engine.job import Job, Wanted
from collalign.options import AlignSession
from collalign.tools.certify.result import JointBound, PairEnergies
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.tilted import TiltedProof, least_energies, prove_tilted
from pairwise.certificates.verify import gram_bound
from pairwise.problem import Problem
from pairwise.rotation_sets import rotation_set


class RoundTuning(NamedTuple):
    """Numbers by which multipliers are improved; energies are shares of the mean energy of a pair.

    Chosen on eight teeth. A round of proofs takes about three times as long as one of descents.
    """

    steps: int = 30
    """Alternations per round, ..."""
    share_steps: int = 8
    """... steps of the shares in each, ..."""
    penalty: float = 0.1
    """... and the penalty."""
    new: float = 1e-4
    """A column is new if some entry differs by this from those of the pair that are known."""
    gap: float = 5e-4
    """How exactly each pair is bounded: what the joint bound loses to it."""
    descent_pairs: int = 10_000
    """Rounds of descents before each round of proofs: pairs times rounds, ..."""
    most_descents: int = 5
    """... and most."""
    most_rounds: int = 3
    """Rounds of proofs of all pairs at most. They end once ..."""
    enough: float = 0.999
    """... this share of the cheapest known energy is proven, ..."""
    settled: float = 1e-3
    """... or the columns promise no more than this share above what is."""
    cheaper: float = 1e-3
    """The multipliers are made again for an arrangement that is cheaper by this share."""
    num_kept: int = 8
    """Columns kept of each search."""
    num_jittered: int = 4
    """Besides the columns in use, each descent starts from so many rotations of the best pose, ..."""
    jitter_rad: float = 0.1
    """... turned by this, ..."""
    num_far: int = 6
    """... and from so many ..."""
    num_starts: int = 16
    """... of these rotations."""
    least_energy: float = 1e-6
    """Smallest energy, as a share of a shape's square size, that tolerances are taken of."""
    perturbed_pairs: int = 6000
    """Descents from perturbed arrangements: pairs times descents, ..."""
    most_perturbed: int = 200
    """... and most."""


TUNED = RoundTuning()
#: Most rows of the Gram matrix: its eigenvectors are computed in every step, a second for this many.
MOST_ROWS = 1500


class JointMaster:
    """The columns and dual variables of some pairs of N shapes.

    Parameters
    ----------
    num_shapes : int
    edges : ndarray of int, shape (E, 2)
    known : ndarray, shape (E, d, d)
        A first column of each pair: those of one arrangement.
    energies : ndarray, shape (E,)
        Of these columns.
    unit : float
        Of the energy of a pair.

    Attributes
    ----------
    tilts : ndarray, shape (E, d, d)
        L_ij; zero before the first round.
    diagonal : ndarray, shape (N, d, d)
        Y_i.
    """

    def __init__(
        self, num_shapes: int, edges: IntArray, known: FloatArray, energies: FloatArray, unit: float
    ) -> None:
        self._edges, self._dim, self._penalty = edges, known.shape[-1], TUNED.penalty * unit
        self._columns, self._energies, self._shares = (
            known[:, None],
            energies[:, None],
            np.ones((len(edges), 1)),
        )
        self.tilts, self.diagonal = (
            np.zeros_like(known),
            np.zeros((num_shapes, self._dim, self._dim)),
        )
        self._blocks = self._with_diagonal(np.eye(self._dim), known)
        self._dual = np.zeros_like(self._blocks)

    @property
    def is_large(self) -> bool:
        """Whether there are too many shapes for anything but L = 0."""
        return self.tilts.shape[-1] * len(self.diagonal) > MOST_ROWS

    @property
    def gram(self) -> FloatArray:
        """The relaxed Gram matrix of all poses, (dN, dN)."""
        return self._blocks.reshape(len(self.diagonal) * self._dim, -1)

    def add(self, pair: int, rotations: FloatArray, energies: FloatArray) -> None:
        """Add columns (m, d, d) of a pair with their energies F (m,), those that are known left out."""
        for rotation, energy in zip(rotations, energies, strict=True):
            if np.abs(self._columns[pair] - rotation).max(axis=(1, 2)).min() > TUNED.new:
                at = int(np.isfinite(self._energies[pair]).sum())
                if at == self._energies.shape[1]:
                    room = ((0, 0), (0, at))
                    self._columns = np.pad(self._columns, (*room, (0, 0), (0, 0)))
                    self._energies = np.pad(self._energies, room, constant_values=np.inf)
                    self._shares = np.pad(self._shares, room)
                self._columns[pair, at], self._energies[pair, at] = rotation, energy

    def used(self, pair: int) -> FloatArray:
        """Return the columns of a pair that have a share, (m, d, d)."""
        return self._columns[pair][self._shares[pair] > 0.0]

    @one_blas_thread()
    def run(self) -> float:
        """Alternate for one round; return the bound that holds if there is no rotation but the columns."""
        left, right = self._edges.T
        for _ in range(TUNED.steps):
            mixed = self._blocks - self._dual
            self._improve_shares(mixed[left, :, right])
            means = (self._shares[..., None, None] * self._columns).sum(axis=1)
            wanted = self._dual + self._with_diagonal(np.eye(self._dim), means, mixed)
            self._blocks = _positive_part(wanted)
            self._dual = wanted - self._blocks
        every, slack = np.arange(len(self.diagonal)), -self._penalty * self._dual
        self.tilts, self.diagonal = 2.0 * slack[left, :, right], slack[every, :, every]
        return float(self.least().sum() - np.trace(self.diagonal, axis1=1, axis2=2).sum())

    def least(self) -> FloatArray:
        """Return the least of F - <L, .> over the columns of each pair, shape (E,)."""
        return np.asarray(
            (self._energies - (self._columns * self.tilts[:, None]).sum(axis=(2, 3))).min(axis=1)
        )

    def _improve_shares(self, wanted: FloatArray) -> None:
        """Lower ``<energies, shares> + penalty |columns^T shares - wanted|^2`` of all pairs, step by step.

        Each step moves share from the column of largest gradient that has some to that of least gradient.
        """
        pairs, points = np.arange(len(wanted)), self._columns.reshape(*self._energies.shape, -1)
        away = (self._shares[..., None] * points).sum(axis=1) - wanted.reshape(len(wanted), -1)
        gradient = self._energies + 2.0 * self._penalty * (points @ away[..., None])[..., 0]
        for _ in range(TUNED.share_steps):
            low = gradient.argmin(axis=1)
            high = np.where(self._shares > 0.0, gradient, -np.inf).argmax(axis=1)
            step = points[pairs, low] - points[pairs, high]
            fall = gradient[pairs, high] - gradient[pairs, low]
            bend = 2.0 * self._penalty * (step**2).sum(axis=1)
            moved = np.minimum(self._shares[pairs, high], fall / np.maximum(bend, 1e-300))
            self._shares[pairs, low] += moved
            self._shares[pairs, high] -= moved
            gradient += 2.0 * self._penalty * moved[:, None] * (points @ step[..., None])[..., 0]
        self._shares = np.maximum(self._shares, 0.0)

    def _with_diagonal(
        self, own: FloatArray, blocks: FloatArray, start: FloatArray | None = None
    ) -> FloatArray:
        """Return a matrix (N, d, N, d) with blocks of the pairs, the same on the diagonal, and else the start's."""
        (left, right), every = self._edges.T, np.arange(len(self.diagonal))
        matrix = (
            np.zeros((len(every), self._dim, len(every), self._dim)) if start is None else start
        )
        matrix[left, :, right], matrix[right, :, left] = blocks, np.swapaxes(blocks, 1, 2)
        matrix[every, :, every] = own
        return matrix


def _positive_part(blocks: FloatArray) -> FloatArray:
    """Return the nearest positive semidefinite matrix, from its positive eigenvalues alone: its rank is low."""
    size = blocks.shape[0] * blocks.shape[1]
    matrix = blocks.reshape(size, size)
    values, vectors = scipy.linalg.eigh(
        0.5 * (matrix + matrix.T), subset_by_value=(0.0, np.inf), driver="evr"
    )
    return np.asarray(((vectors * values) @ vectors.T).reshape(blocks.shape))


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
    """Return the matching problem of two shapes of a joint bound."""
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
        tasks = {
            e: self._shapes(e) | group | {"tilt": tilts[e], "known": some}
            for e, some in enumerate(known)
        }
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
            settings = {
                "group": group,
                "tilt": master.tilts[e],
                "known": master.used(e),
                "gap": gap,
            }
            wanted[e] = Wanted(
                key=BOUNDING.key(settings, self.keys[i], self.keys[j]),
                label=f"pair {i}, {j}",
                arguments=self._shapes(e)
                | settings
                | {"time_limit_s": self.session.run.pair_time_limit_s},
            )
        found = self.session.compute(BOUNDING, wanted, time_limit_s=None, until=deadline)
        sides = 2 if group == "O" else 1
        return [
            found[e] if e in found else unproven(-bound, sides)
            for e, bound in enumerate(most.tolist())
        ]

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
    num = min(TUNED.perturbed_pairs // len(edges), TUNED.most_perturbed)
    best, energy = energies.perturb(near, np.random.default_rng(0), num)
    unit = _unit(energies, energy)
    master = JointMaster(
        energies.num_shapes, edges, energies.relative(best), energies.at(best), unit
    )
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
            unit, rotations, values = (
                _unit(energies, energy),
                energies.relative(best),
                energies.at(best),
            )
            for pair in range(len(edges)):
                master.add(pair, rotations[pair : pair + 1], values[pair : pair + 1])
            if energy < (1.0 - TUNED.cheaper) * former:
                continue
        proofs = rounds.prove(master, TUNED.gap * unit, deadline)
        _add(master, proofs)
        bounds.append(
            sum(proof.lower_bound for proof in proofs)
            + gram_bound(edges, master.tilts, master.diagonal)
        )
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

    Pairs descend from columns with a share, rotations of the best pose by a few degrees and some of all rotations.
    """
    starts = rotation_set(3, TUNED.num_starts)
    starts = np.concatenate([starts, -starts]) if rounds.session.options.group == "O" else starts
    relative = rounds.energies.relative(best)
    promised = master.run()
    for _ in range(int(np.clip(TUNED.descent_pairs // len(relative), 1, TUNED.most_descents))):
        if time.monotonic() >= deadline:
            break
        rotations = scipy.spatial.transform.Rotation.from_rotvec(
            TUNED.jitter_rad * rng.standard_normal((TUNED.num_jittered, 3))
        ).as_matrix()
        far = starts[rng.choice(len(starts), TUNED.num_far)]
        known = [
            np.concatenate([master.used(e), one @ rotations, far]) for e, one in enumerate(relative)
        ]
        _add(master, rounds.descend(master.tilts, known))
        promised = master.run()
    return promised


def _unit(energies: PairEnergies, best: float) -> float:
    """Return the mean energy of a pair, which tolerances are shares of."""
    return max(
        best / len(energies.edges),
        TUNED.least_energy * float((energies.problems[0].target ** 2).sum()),
    )


def _add(master: JointMaster, found: Sequence[TiltedProof]) -> None:
    """Make columns of what was found, the least of each pair."""
    for e, proof in enumerate(found):
        master.add(e, proof.rotations[: TUNED.num_kept], proof.energies[: TUNED.num_kept])


def _ended(
    bounds: Sequence[float], promised: float, energy: float, is_large: bool, is_late: bool
) -> str:
    """Return the code of why no further round begins, empty if one does."""
    if max(bounds) >= TUNED.enough * energy:
        return "enough"
    if is_large:
        return "too-many"
    if promised - max(bounds) <= TUNED.settled * energy:
        return "no-gain"
    if len(bounds) >= TUNED.most_rounds:
        return "rounds"
    return "time" if is_late else ""
