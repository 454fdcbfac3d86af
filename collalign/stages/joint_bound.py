"""A lower bound for all consistent arrangements of some shapes together, by rounds of proofs of all their pairs.

Each round takes multipliers from the master problem (:mod:`collalign.synchronization.bound.master`), and bounds every
pair's energy less a linear function of its rotation by branch and bound, in the workers. Any multipliers prove a
bound, and the best of all rounds counts; the rotations where the pairs' minima lie make the next multipliers better.
Rounding the relaxed Gram matrix also leads to arrangements that may be cheaper than any known one.

Every proof of a pair is kept in the store under the pair, the multipliers and the rotations it started from, and the
rounds are repeatable: an interrupted certification goes through them again at no cost and goes on.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from collalign.engine.jobs.job import Job, Wanted
from collalign.options import AlignSession
from collalign.products.joint_bound import JointBound
from collalign.products.matching_input import pair_problem
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.shapes import SAMPLING
from collalign.synchronization.bound.arrangement import Arrangement, PairEnergies
from collalign.synchronization.bound.master import JointMaster
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.checks import check_number
from data_tools.embedding.embedding import Samples
from data_tools.errors import CollectionError, OptionsError
from pairwise.branch_and_bound.prove import can_certify
from pairwise.branch_and_bound.tilted import TiltedProof, prove_tilted
from pairwise.problem.problem import energy_scale

#: How exactly each pair is bounded, as a share of the mean energy of a pair: what the joint bound loses to it.
_GAP = 5e-4
#: The rounds end when what the columns promise exceeds what is proven by no more than this share of the energy.
_SETTLED = 5e-4
#: Smallest energy, as a share of the shapes' spread, that shares are taken of.
_LEAST_ENERGY = 1e-6
#: Descents from perturbed arrangements before the first round and after the last: pairs times descents, and most.
_PERTURBED_PAIRS, _MOST_PERTURBED = 3000, 100


@dataclass(frozen=True, kw_only=True)
class CertifyOptions:
    """How far a certification goes.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    max_rounds: int = 20
    """Rounds of proofs of all pairs."""

    enough: float = 0.999
    """Stop once this share of the cheapest known arrangement's energy is proven."""

    budget_s: float = 3600.0
    """Seconds after which no further round begins."""

    def __post_init__(self) -> None:
        if isinstance(self.max_rounds, bool) or not isinstance(self.max_rounds, int) or self.max_rounds < 1:
            raise OptionsError(f"max_rounds: expected an integer of at least 1, got {self.max_rounds!r}")
        if not 0.0 < self.enough <= 1.0:
            raise OptionsError(f"enough: expected a share above 0 and at most 1, got {self.enough!r}")
        check_number("budget_s", self.budget_s, positive=True)


def bound_pair(
    target: Samples,
    source: Samples,
    group: str,
    tilt: FloatArray,
    known: FloatArray,
    gap: float,
    time_limit_s: float,
) -> TiltedProof:
    """Bound a pair's energy less a linear function of its rotation; runs inside a worker."""
    return prove_tilted(pair_problem(target, source, group), tilt, known, gap=gap, time_limit_s=time_limit_s)


#: Bounds a pair. The version changes whenever the same pair and multipliers would give another bound.
BOUNDING = Job(kind="proofs", version="joint-1", run=bound_pair, reader=TiltedProof)


def bound_collection(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    frames: FloatArray,
    options: CertifyOptions,
) -> JointBound:
    """Bound the energy of every arrangement of the shapes from below, and seek a cheaper one than the given.

    Parameters
    ----------
    session : Session
        Its group is decided, "SO" or "O".
    shapes : Shapes
    pairs : sequence of Pair
        Whose energies count; ``target`` and ``source`` are positions in ``shapes``.
    frames : ndarray, shape (N, 3, 3)
        ``R_common_shape`` of the arrangement that is to be judged.
    options : CertifyOptions

    Raises
    ------
    OptionsError
        If the embedding has more than the coordinates of space, or the shapes are too many at once.
    CollectionError
        If the proof of a pair failed.
    """
    started, edges = time.monotonic(), np.array([(pair.target, pair.source) for pair in pairs], dtype=np.int64)
    problems = [pair_problem(shapes.samples[i], shapes.samples[j], session.options.group) for i, j in edges]
    if not can_certify(problems[0]):
        raise OptionsError("the shapes are embedded in more than space: there is no joint bound for such embeddings")
    energies = PairEnergies(len(shapes.names), edges, problems)
    stated, near = float(energies.at(frames).sum()), energies.descend(frames)
    rng, num = np.random.default_rng(0), int(np.clip(_PERTURBED_PAIRS // len(pairs), 1, _MOST_PERTURBED))
    perturbed = energies.perturb(near, rng, num)
    scale = max(perturbed.energy, _LEAST_ENERGY * sum(map(energy_scale, problems)))
    bounder = _Bounder(session=session, shapes=shapes, edges=edges, gap=_GAP * scale / len(pairs))
    known = [
        np.concatenate([rotation[None], pair.rotations])
        for rotation, pair in zip(energies.relative(perturbed.frames), pairs, strict=True)
    ]
    found = _run_rounds(energies, perturbed, bounder, known, scale, started + options.budget_s, options)
    best = energies.perturb(found.best, rng, num)
    return JointBound(
        names=shapes.names,
        edges=read_only(edges),
        num_points=problems[0].num_source,
        stated_energy=stated,
        near_energy=near.energy,
        perturbed_energy=perturbed.energy,
        rounded_energy=found.rounded_energy,
        energy=best.energy,
        frames=read_only(best.frames),
        pair_bounds=read_only(found.pair_bounds),
        bounds=read_only(np.array(found.bounds)),
        ended=found.ended,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rounds:
    """What all rounds found."""

    pair_bounds: FloatArray
    bounds: list[float]
    rounded_energy: float
    best: Arrangement
    ended: str


def _run_rounds(
    energies: PairEnergies,
    best: Arrangement,
    bounder: _Bounder,
    known: Sequence[FloatArray],
    scale: float,
    deadline: float,
    options: CertifyOptions,
) -> _Rounds:
    """Bound all pairs alone, then with the multipliers of one round after the other."""
    relative, num = energies.relative(best.frames), len(energies.edges)
    master = JointMaster(energies.num_shapes, energies.edges, relative, energies.at(best.frames), unit=scale / num)
    proofs = bounder.bound(np.zeros_like(relative), known)
    pair_bounds = np.array([proof.lower_bound for proof in proofs])
    bounds, promised, rounded = [float(pair_bounds.sum())], np.inf, np.nan
    while not (ended := _ended(bounds, promised, best.energy, scale, deadline, options)):
        for pair, proof in enumerate(proofs):
            master.add(pair, proof.rotations, proof.energies)
        multipliers = master.run()
        promised = multipliers.column_bound
        proofs = bounder.bound(multipliers.tilts, [master.used(pair) for pair in range(num)])
        bounds.append(multipliers.gram_bound + sum(proof.lower_bound for proof in proofs))
        found = energies.descend(energies.rounded(master.gram))
        rounded = float(np.fmin(rounded, found.energy))
        best = _cheaper(energies, best, found, master)
    return _Rounds(pair_bounds=pair_bounds, bounds=bounds, rounded_energy=rounded, best=best, ended=ended)


def _ended(
    bounds: Sequence[float], promised: float, energy: float, scale: float, deadline: float, options: CertifyOptions
) -> str:
    """Return why no further round begins, empty if one does."""
    best = max(bounds)
    if best >= energy - (1.0 - options.enough) * scale:
        return "enough is proven"
    if promised - best <= _SETTLED * scale:
        return "the bound no longer rises"
    if len(bounds) > options.max_rounds:
        return "the rounds ended"
    return "the time ended" if time.monotonic() >= deadline else ""


def _cheaper(energies: PairEnergies, best: Arrangement, found: Arrangement, master: JointMaster) -> Arrangement:
    """Return the cheaper of two arrangements; a new one becomes columns of the master problem."""
    if found.energy >= best.energy:
        return best
    values = energies.at(found.frames)
    for pair, rotation in enumerate(energies.relative(found.frames)):
        master.add(pair, rotation[None], values[pair : pair + 1])
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bounder:
    """Bounds all pairs in the workers; what the store holds already is taken from there."""

    session: AlignSession
    shapes: Shapes
    edges: IntArray
    gap: float

    def bound(self, tilts: FloatArray, known: Sequence[FloatArray]) -> list[TiltedProof]:
        """Return the proof of each pair at the tilts (E, d, d), started from known rotations.

        Raises
        ------
        CollectionError
            If one of them failed.
        """
        wanted = {
            (i, j): self._wanted(i, j, np.ascontiguousarray(tilt), np.ascontiguousarray(some))
            for (i, j), tilt, some in zip(self.edges.tolist(), tilts, known, strict=True)
        }
        found = self.session.compute(BOUNDING, wanted, time_limit_s=None)
        for ends, reason in found.failures.items():
            raise CollectionError(f"{wanted[ends].label}: its energy could not be bounded ({reason})")
        return list(found.values())

    def _wanted(self, i: int, j: int, tilt: FloatArray, known: FloatArray) -> Wanted:
        group, ends = self.session.options.group, (self.shapes.keys[i], self.shapes.keys[j])
        arrays = (hashlib.sha256(array.tobytes()).hexdigest() for array in (tilt, known))
        return Wanted(
            key=BOUNDING.key({"group": group, "gap": self.gap}, *ends, *arrays),
            label=self.shapes.label(i, j),
            arguments={
                "target": SAMPLING.shared(ends[0]),
                "source": SAMPLING.shared(ends[1]),
                "group": group,
                "tilt": tilt,
                "known": known,
                "gap": self.gap,
                "time_limit_s": self.session.run.pair_time_limit_s,
            },
        )
