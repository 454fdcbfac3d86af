"""Checks the lower bound of all arrangements of a result, and says what was found about all its certificates.

``certificates/3-7.npz`` is the certificate of the pair whose target and source are the shapes 3 and 7 in the order of
``alignment.json``; ``certificates/problems.npz`` holds the samples of all shapes as they were matched.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.products.pair import Pair
from collalign.products.run_record import Made
from data_tools.arrays import as_floats, as_indices, as_rotations
from data_tools.errors import InputError
from data_tools.io.output_folder import OutputFolder
from pairwise.certificates.verify import CLAIM_TOL, gram_bound
from pairwise.certificates.verify_cells import tilted_bound
from pairwise.local_search import MatchingCosts
from pairwise.problem import Problem

#: A bound of ``pairs.csv`` counts as proven from this share of it on.
_PROVEN_SHARE = 1.0 - 1e-6


@dataclass(frozen=True, kw_only=True)
class CheckedCollection:
    """What was found about the proof of a collection.

    Attributes
    ----------
    num_shapes, num_pairs : int
    proven : float
        No arrangement of the shapes costs less; NaN where the proof is refused.
    energy : float
        Of the arrangement in the file.
    fault : str
        Why the proof is refused, empty if it is not.
    """

    num_shapes: int
    num_pairs: int
    proven: float
    energy: float
    fault: str = ""

    def __str__(self) -> str:
        if self.fault:
            return f"Collection: REFUSED, {self.fault}"
        more = f", {100 * (self.energy / self.proven - 1.0):.2f} % more" if self.proven > 0 else ""
        return (
            f"Collection: no arrangement of the {self.num_shapes} shapes costs less than {self.proven:.6g} over "
            f"{self.num_pairs} pairs; the cheapest one known costs {self.energy:.6g}{more}."
        )


@dataclass(frozen=True, kw_only=True)
class CheckedPair:
    """What was found about the certificate of one pair.

    Attributes
    ----------
    target, source : str
        The shapes' names.
    kind : str
        Of the certificate; empty where it could not be read.
    proven : float
        The lower bound of the pair's energy that it proves; NaN where it is refused.
    stated : float
        The lower bound in ``pairs.csv``, NaN where there is none.
    fault : str
        Why the certificate is refused, empty if it is not.
    """

    target: str
    source: str
    kind: str
    proven: float
    stated: float
    fault: str = ""


@dataclass(frozen=True, kw_only=True)
class Verification:
    """The certificates of a result, checked.

    Attributes
    ----------
    pairs : tuple of CheckedPair
    num_stated : int
        Pairs with a lower bound in ``pairs.csv``.
    collection : CheckedCollection or None
        What `collalign certify` left, where it did.
    """

    pairs: tuple[CheckedPair, ...]
    num_stated: int
    collection: CheckedCollection | None = None

    @property
    def holds(self) -> bool:
        """Whether no certificate is refused."""
        return not any(pair.fault for pair in self.pairs) and not (
            self.collection and self.collection.fault
        )

    @property
    def num_proven(self) -> int:
        """Number of pairs whose bound in ``pairs.csv`` is proven by their certificate."""
        return sum(pair.proven >= _PROVEN_SHARE * pair.stated for pair in self.pairs)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON; a number that is not known is null."""
        record = {"holds": self.holds, "num_stated": self.num_stated, "num_proven": self.num_proven}
        found = record | {"pairs": [_known(asdict(pair)) for pair in self.pairs]}
        return (
            found
            if self.collection is None
            else found | {"collection": _known(asdict(self.collection))}
        )

    def table(self) -> str:
        """Return one line per certificate and what they say together."""
        lines = [
            f"{pair.target} - {pair.source}: "
            + (
                f"REFUSED, {pair.fault}"
                if pair.fault
                else f"{pair.kind} proves {pair.proven:.6g}, pairs.csv states {pair.stated:.6g}"
            )
            for pair in self.pairs
        ]
        refused = sum(bool(pair.fault) for pair in self.pairs)
        hold = "all hold" if not refused else f"{refused} REFUSED"
        lines.append(
            f"{len(self.pairs)} certificates, {hold}. pairs.csv states {self.num_stated} lower bounds: "
            f"{self.num_proven} are proven by a certificate, the others are the word of the program that found them."
        )
        return "\n".join(lines if self.collection is None else [*lines, str(self.collection)])


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields with null for numbers that are not known."""
    return {name: None if value != value else value for name, value in fields.items()}


#: The arrays of the file other than the samples.
PROOF_ARRAYS = ("edges", "frames", "tilts", "diagonal", "num_cells", "depths", "bound")
#: Numbers beyond this are refused: their products would overflow.
_LARGEST_MULTIPLIER = 1e50


def check_collection(
    arrays: Mapping[str, NDArray[Any]], num_shapes: int, problem: Callable[[int, int], Problem]
) -> CheckedCollection:
    """Say what a proof of a collection proves.

    Parameters
    ----------
    arrays : mapping of name to ndarray
        :data:`PROOF_ARRAYS` of E pairs and N shapes: edges (E, 2), frames and diagonal (N, 3, 3), tilts (E, 3, 3),
        num_cells (E, 1 or 2), depths (cells,) and bound (); nothing about them is believed.
    num_shapes : int
    problem : callable
        The problem of two shapes, by their numbers; it refuses pairs that are none of the result.
    """
    try:
        return _check(arrays, num_shapes, problem)
    except (InputError, FloatingPointError, OverflowError, np.linalg.LinAlgError) as error:
        nothing = float("nan")
        return CheckedCollection(
            num_shapes=num_shapes, num_pairs=0, proven=nothing, energy=nothing, fault=str(error)
        )


def _check(
    arrays: Mapping[str, NDArray[Any]], num_shapes: int, problem: Callable[[int, int], Problem]
) -> CheckedCollection:
    edges = as_indices(arrays["edges"], "edges", upper=num_shapes, shape=(None, 2))
    distinct = {frozenset(edge) for edge in edges.tolist() if edge[0] != edge[1]}
    if not 0 < len(edges) == len(distinct):
        raise InputError("edges: no pairs, a pair twice, or one of a shape with itself")
    tilts = as_floats(arrays["tilts"], "tilts", shape=(len(edges), 3, 3))
    diagonal = as_floats(arrays["diagonal"], "diagonal", shape=(num_shapes, 3, 3))
    frames = as_rotations(as_floats(arrays["frames"], "frames", shape=(num_shapes, 3, 3)), "frames")
    if max(np.abs(tilts).max(), np.abs(diagonal).max()) > _LARGEST_MULTIPLIER:
        raise InputError("tilts or diagonal: numbers that are too large")
    problems = [problem(i, j) for i, j in edges.tolist()]
    sides = 1 if problems[0].pattern.special_blocks else 2
    if sides == 1 and (np.linalg.det(frames) < 0.0).any():
        raise InputError("frames: a shape is reflected, which the result's group forbids")
    depths = as_indices(arrays["depths"], "depths", upper=256, shape=(None,))
    counts = as_indices(
        arrays["num_cells"], "num_cells", upper=len(depths) + 1, shape=(len(edges), sides)
    )
    if counts.sum() != len(depths):
        raise InputError("num_cells: they are not as many as depths")
    cells = np.split(depths, np.cumsum(counts.ravel())[:-1])
    with np.errstate(over="raise", invalid="raise"):
        pair_sum, energy = 0.0, 0.0
        for e, (one, tilt) in enumerate(zip(problems, tilts, strict=True)):
            i, j = edges[e]
            pair_sum += tilted_bound(one, tilt, cells[sides * e : sides * (e + 1)])
            rotation = frames[i].T @ frames[j]
            energy += one.energy(rotation, MatchingCosts(one).assign(rotation[None])[0])
        proven = max(0.0, pair_sum + gram_bound(edges, tilts, diagonal))  # no energy is negative
    claim = float(as_floats(arrays["bound"], "bound", shape=()))
    if not proven >= claim - CLAIM_TOL * max(energy, abs(claim)):
        raise InputError(f"it claims the bound {claim:.12g} but proves {proven:.12g}")
    return CheckedCollection(
        num_shapes=num_shapes,
        num_pairs=len(edges),
        proven=proven,
        energy=energy,
    )


CERTIFICATE_FOLDER = "certificates"
PROBLEMS_FILE = "problems.npz"
#: What `collalign certify` leaves for others to check, and its name in the manifest of an output folder.
PROOF_FILE, CERTIFIER = "certification.npz", "certify"


def write_certificates(pairs: Sequence[Pair], made: Made, output: OutputFolder) -> None:
    """Stage the certificates of all pairs that have one, and the problems that they are about."""
    certified = [(pair, pair.certificate) for pair in pairs if pair.certificate is not None]
    for pair, certificate in certified:
        certificate.save(output.stage(CERTIFICATE_FOLDER, f"{pair.target}-{pair.source}.npz"))
    if certified:
        path = output.stage(CERTIFICATE_FOLDER, PROBLEMS_FILE)
        np.savez_compressed(path, coordinates=made.coordinates, invariants=made.invariants)
