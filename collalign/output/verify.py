"""Checks the certificates of a result: every pair's problem is stated here, and compared with its certificate.

The problem is that of the samples in ``certificates/problems.npz``, with all maps and the group that
``alignment.json`` says; these must be the samples of ``correspondences.npz`` up to position, size and rotation.
"""

from __future__ import annotations

import csv
import json
import re
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.output.certificates import CERTIFICATE_FOLDER, PROBLEMS_FILE
from collalign.output.write import ALIGNMENT_FILE, CORRESPONDENCES_FILE, PAIRS_FILE
from data_tools.arrays import FloatArray, as_floats
from data_tools.errors import InputError
from data_tools.io.csv_cells import plain_cell
from data_tools.rotations import nearest_orthogonal
from data_tools.threads import one_blas_thread
from pairwise.certificates.certificate import MAX_BYTES, Certificate
from pairwise.certificates.verify import verify_certificate
from pairwise.problem.problem import Problem

#: Largest distance, as a share of a shape's size, between its samples in the common frame and as they were matched.
_SAMPLE_TOL = 1e-6

#: A bound of ``pairs.csv`` counts as proven from this share of it on.
_PROVEN_SHARE = 1.0 - 1e-6


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
    """

    pairs: tuple[CheckedPair, ...]
    num_stated: int

    @property
    def holds(self) -> bool:
        """Whether no certificate is refused."""
        return not any(pair.fault for pair in self.pairs)

    @property
    def num_proven(self) -> int:
        """Number of pairs whose bound in ``pairs.csv`` is proven by their certificate."""
        return sum(pair.proven >= _PROVEN_SHARE * pair.stated for pair in self.pairs)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON; a number that is not known is null."""
        known = [
            {name: None if value != value else value for name, value in asdict(pair).items()} for pair in self.pairs
        ]
        return {"holds": self.holds, "pairs": known, "num_stated": self.num_stated, "num_proven": self.num_proven}

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
        hold = "all hold" if self.holds else f"{refused} REFUSED"
        lines.append(
            f"{len(self.pairs)} certificates, {hold}. pairs.csv states {self.num_stated} lower bounds: "
            f"{self.num_proven} are proven by a certificate, the others are the word of the program that found them."
        )
        return "\n".join(lines)


@one_blas_thread()
def verify_result(folder: Path | str) -> Verification:
    """Check every certificate of a result's folder.

    Raises
    ------
    InputError
        If the folder holds no certificates, or what they are about cannot be read or is about other shapes. A
        certificate that is refused is no error but a ``fault`` of its pair.
    """
    folder = Path(folder)
    files = sorted((folder / CERTIFICATE_FOLDER).glob("*-*.npz"), key=_shapes_of)
    if not files:
        raise InputError(f"{folder}: holds no certificates; `collalign align FOLDER --out OUT --certify` makes them")
    names, group = _names_and_group(folder / ALIGNMENT_FILE)
    stated = _stated_bounds(folder / PAIRS_FILE)
    coordinates, invariants = _matched_samples(folder, len(names))
    checked = []
    for file in files:
        target, source = _shapes_of(file)
        if max(target, source) >= len(names):
            raise InputError(f"{file}: the result has only {len(names)} shapes")
        bound = stated.get((names[target], names[source]), float("nan"))
        try:
            certificate = Certificate.load(file)
            problem = Problem.from_user(
                coordinates[target],
                coordinates[source],
                group=group,
                rotation_pattern=None if coordinates.shape[2] == 3 else (3, coordinates.shape[2] - 3),
                invariants=(invariants[target], invariants[source]),
            )
            proven = verify_certificate(problem.target, problem.source, certificate, problem=problem)
            found = CheckedPair(
                target=names[target], source=names[source], kind=certificate.kind, proven=proven, stated=bound
            )
        except InputError as error:
            found = CheckedPair(
                target=names[target],
                source=names[source],
                kind="",
                proven=float("nan"),
                stated=bound,
                fault=str(error),
            )
        checked.append(found)
    return Verification(pairs=tuple(checked), num_stated=sum(bound == bound for bound in stated.values()))


def _shapes_of(file: Path) -> tuple[int, int]:
    """Return the numbers of a certificate's target and source, from its name."""
    match = re.fullmatch(r"(\d{1,9})-(\d{1,9})\.npz", file.name)
    if match is None:
        raise InputError(f"{file}: not the name of a certificate, expected TARGET-SOURCE.npz with two numbers")
    return int(match[1]), int(match[2])


def _names_and_group(file: Path) -> tuple[list[str], str]:
    """Return the shapes' names and the group that was decided."""
    try:
        record = json.loads(file.read_text("utf-8"))
        return [str(shape["name"]) for shape in record["shapes"]], str(record["decided"]["group"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{file}: cannot be read as a result ({error})") from None


def _stated_bounds(file: Path) -> dict[tuple[str, str], float]:
    """Return the lower bound of every pair of the table, NaN where there is none."""
    try:
        with file.open(newline="", encoding="utf-8") as table:
            return {
                (plain_cell(row["target"]), plain_cell(row["source"])): float(row["lower_bound"] or "nan")
                for row in csv.DictReader(table)
            }
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise InputError(f"{file}: cannot be read as a table of pairs ({error})") from None


def _matched_samples(folder: Path, num_shapes: int) -> tuple[FloatArray, FloatArray]:
    """Return the samples as they were matched, (N, k, d), and their invariants, once they are those of the result."""
    matched = _load(folder / CERTIFICATE_FOLDER / PROBLEMS_FILE, ("coordinates", "invariants"))
    coordinates = as_floats(matched["coordinates"], "coordinates", shape=(num_shapes, None, None))
    num_samples = coordinates.shape[1]
    invariants = as_floats(matched["invariants"], "invariants", shape=(num_shapes, num_samples, None))
    placed = _load(folder / CORRESPONDENCES_FILE, ("positions",))["positions"]
    positions = as_floats(placed, "positions", shape=(num_shapes, num_samples, 3))
    for i in range(num_shapes):
        if not _deviation(positions[i], coordinates[i, :, :3]) <= _SAMPLE_TOL:
            raise InputError(
                f"{folder / CERTIFICATE_FOLDER / PROBLEMS_FILE}: the samples of shape {i} are not those of "
                f"{CORRESPONDENCES_FILE}; the certificates are about other shapes"
            )
    return coordinates, invariants


def _deviation(target: FloatArray, source: FloatArray) -> float:
    """Return the largest distance after the best similarity, mirrored or not, as a share of the target's size."""
    q, p = (points - points.mean(axis=0) for points in (target, source))
    sizes = [float(np.linalg.norm(points)) for points in (q, p)]
    if min(sizes) == 0.0:
        return 0.0 if max(sizes) == 0.0 else np.inf
    moved = (p / sizes[1]) @ nearest_orthogonal((q / sizes[0]).T @ (p / sizes[1])).T
    return float(np.linalg.norm(moved - q / sizes[0], axis=1).max())


def _load(file: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Read arrays of an archive that is not trusted to be small or whole."""
    try:
        with zipfile.ZipFile(file) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
                raise InputError(f"more than {MAX_BYTES} bytes")
        with np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in names}
    except Exception as error:  # damaged archives fail in every way there is
        raise InputError(f"{file}: cannot be read ({error})") from None
