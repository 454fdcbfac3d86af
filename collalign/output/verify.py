"""Checks the certificates of a result: every pair's problem is stated here, and compared with its certificate.

The problem is that of the samples in ``certificates/problems.npz``, with all maps and the group that
``alignment.json`` says. These must be the samples of ``correspondences.npz``, taken back by the transforms of
``alignment.json``, centred and scaled as its options say; nothing else holds the invariants. No bound may
exceed the pair's energy in ``pairs.csv``. Files that the manifest does not name are not looked at.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collalign.output.certificates import (
    CERTIFICATE_FOLDER,
    CERTIFIER,
    PROBLEMS_FILE,
    PROOF_ARRAYS,
    PROOF_FILE,
    CheckedCollection,
    CheckedPair,
    Verification,
    check_collection,
)
from collalign.output.collection_data import MESH_FOLDER
from collalign.output.evidence_file import CORRESPONDENCES_FILE
from collalign.output.write import ALIGNMENT_FILE, PAIRS_FILE, WRITER
from data_tools.arrays import FloatArray, as_floats, as_indices
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.files import file_stems, open_regular, read_text
from data_tools.io.output_folder import written_files
from data_tools.io.shapes import read_shape
from data_tools.io.text_tables import plain_cell
from data_tools.options import AS_STORED
from data_tools.surface.laplacian import vertex_areas
from data_tools.threads import one_blas_thread
from pairwise.certificates.certificate import MAX_BYTES, Certificate
from pairwise.certificates.verify import verify_certificate
from pairwise.problem import LARGEST_COORDINATE, Problem

#: Largest distance, as a share of a shape's size, between its samples in the common frame and as they were matched.
_SAMPLE_TOL = 1e-6
#: Areas of a surface and of the simplified copy that the run took it of differ by less than this share.
_AREA_TOL = 0.05

#: A bound may exceed the energy by rounding: shares of the energy, and of the squares of both shapes.
_ENERGY_TOL, _SQUARES_TOL = 1e-6, 1e-9


@dataclass(frozen=True, kw_only=True)
class _Result:
    """What a result's folder says of the problems: checked for form, not for truth."""

    names: tuple[str, ...]
    stems: list[str]
    group: str
    normalisation: str
    transforms: FloatArray
    positions: FloatArray
    coordinates: FloatArray
    invariants: FloatArray
    rows: dict[tuple[str, str], tuple[float, float]]

    def problem(self, target: int, source: int) -> Problem:
        """Return the problem of two shapes."""
        dim = self.coordinates.shape[2]
        return Problem.from_user(
            self.coordinates[target],
            self.coordinates[source],
            group=self.group,
            rotation_pattern=None if dim == 3 else (3, dim - 3),
            invariants=(self.invariants[target], self.invariants[source]),
        )

    def exceeds(self, bound: float, energy: float, target: int, source: int) -> bool:
        """Return whether a bound is above the pair's energy, that of the samples in space, or this is not known."""
        with np.errstate(over="ignore"):
            squares = float((self.coordinates[[target, source]] ** 2).sum())
        limit = energy + _ENERGY_TOL * abs(energy) + _SQUARES_TOL * squares
        return self.coordinates.shape[2] == 3 and not (np.isfinite(limit) and bound <= limit)


@one_blas_thread()
def verify_result(folder: Path | str) -> Verification:
    """Check every certificate of a result's folder that its manifest names, and the proof of the whole collection.

    Raises
    ------
    InputError
        If the folder holds no certificates, or what they are about cannot be read, is about other shapes, or states
        bounds above energies. A certificate that is refused is no error but a ``fault`` of its pair.
    """
    folder = Path(folder)
    files, collection = _certificate_files(folder), _check_collection(folder)
    if not files and collection is None:
        raise InputError(
            f"{folder}: holds no certificates; `collalign align FOLDER --out OUT --certify` makes them for pairs, "
            "`collalign certify OUT` for the collection"
        )
    if not files:
        return Verification(pairs=(), num_stated=0, collection=collection)
    file = folder / CERTIFICATE_FOLDER / PROBLEMS_FILE
    result = _read(folder, _load(file, ("coordinates", "invariants")))
    for target, source in files:
        if max(target, source) >= len(result.names):
            raise InputError(
                f"{files[target, source]}: the result has only {len(result.names)} shapes"
            )
    for shape in range(len(result.names)):
        _check_samples(folder, result, shape, file)
    checked = [
        _check_pair(result, file, target, source)
        for (target, source), file in sorted(files.items())
    ]
    num_stated = sum(bound == bound for bound, _ in result.rows.values())
    return Verification(pairs=tuple(checked), num_stated=num_stated, collection=collection)


def _check_collection(folder: Path) -> CheckedCollection | None:
    """Say what the proof of the collection proves, if the manifest names one."""
    if PROOF_FILE not in written_files(folder, CERTIFIER):
        return None
    file = folder / PROOF_FILE
    members, coordinates, invariants, *arrays = _load(
        file, ("members", "coordinates", "invariants", *PROOF_ARRAYS)
    )
    result = _read(folder, [coordinates, invariants], members)
    for shape in range(len(result.names)):
        _check_samples(folder, result, shape, file)

    def problem(target: int, source: int) -> Problem:
        if (result.names[target], result.names[source]) not in result.rows:
            raise InputError(f"edges: {PAIRS_FILE} has no pair of the shapes {target} and {source}")
        return result.problem(target, source)

    return check_collection(
        dict(zip(PROOF_ARRAYS, arrays, strict=True)), len(result.names), problem
    )


def _certificate_files(folder: Path) -> dict[tuple[int, int], Path]:
    """Return the certificates that the manifest names, by the numbers of target and source."""
    named = re.compile(rf"{CERTIFICATE_FOLDER}/(\d{{1,9}})-(\d{{1,9}})\.npz")
    found = (named.fullmatch(name) for name in written_files(folder, WRITER))
    return {(int(name[1]), int(name[2])): folder / name[0] for name in found if name is not None}


def _check_pair(result: _Result, file: Path, target: int, source: int) -> CheckedPair:
    """Say what the certificate of a pair proves."""
    ends = (result.names[target], result.names[source])
    kind, proven, fault = "", float("nan"), ""
    bound, energy = result.rows.get(ends, (float("nan"), float("nan")))
    try:
        if ends not in result.rows:
            raise InputError(f"{file}: {PAIRS_FILE} has no such pair")
        certificate = Certificate.load(file)
        problem = result.problem(target, source)
        value = verify_certificate(problem.target, problem.source, certificate, problem=problem)
        if result.exceeds(value, energy, target, source):
            raise InputError(
                f"{file}: proves {value:.6g}, above the pair's energy {energy:.6g}: not of this problem"
            )
        kind, proven = certificate.kind, value
    except InputError as error:
        fault = str(error)
    return CheckedPair(
        target=ends[0], source=ends[1], kind=kind, proven=proven, stated=bound, fault=fault
    )


def _read(
    folder: Path, samples: Sequence[NDArray[Any]], members: NDArray[Any] | None = None
) -> _Result:
    """Read what certificates of some shapes, or all, are about; damaged and contradictory files are named.

    Parameters
    ----------
    folder : Path
    samples : sequence of ndarray
        Coordinates and invariants of these shapes as they were matched.
    members : ndarray of int, optional
        Their numbers.
    """
    file = folder / ALIGNMENT_FILE
    try:
        record = json.loads(read_text(file))
        names = tuple(str(shape["name"]) for shape in record["shapes"])
        group = str(record["decided"]["group"])
        normalisation = str(record["options"]["sampling"]["normalisation"])
        stated = [shape["transform"] for shape in record["shapes"]]
        transforms = as_floats(stated, "transforms", shape=(None, 4, 4))
    except (ValueError, KeyError, TypeError, RecursionError, OverflowError) as error:
        raise InputError(f"{file}: cannot be read as a result ({error})") from None
    if group not in ("SO", "O") or len(set(names)) < len(names):
        raise InputError(
            f"{file}: no result of this program: names that occur twice, or a group that is neither SO nor O"
        )
    chosen = (
        np.arange(len(names))
        if members is None
        else as_indices(members, "members", upper=len(names))
    )
    if chosen.ndim != 1 or not len(chosen) or len(set(chosen.tolist())) < len(chosen):
        raise InputError("members: not the numbers of some shapes, each once")
    stems = [file_stems(names)[i] for i in chosen]
    names, num_shapes = tuple(names[i] for i in chosen), len(names)
    coordinates = as_floats(samples[0], "coordinates", shape=(len(names), None, None))
    num_samples = coordinates.shape[1]
    if coordinates.shape[2] < 3:
        raise InputError(
            f"coordinates: {coordinates.shape[2]} of each sample, expected at least those in space"
        )
    (placed,) = _load(folder / CORRESPONDENCES_FILE, ("positions",))
    result = _Result(
        names=names,
        group=group,
        normalisation=normalisation,
        transforms=transforms[chosen],
        stems=stems,
        positions=as_floats(placed, "positions", shape=(num_shapes, num_samples, 3))[chosen],
        coordinates=coordinates,
        invariants=as_floats(samples[1], "invariants", shape=(len(names), num_samples, None)),
        rows=_pair_rows(folder / PAIRS_FILE),
    )
    numbers = {name: number for number, name in enumerate(names)}
    for (target, source), (bound, energy) in result.rows.items():
        known = bound == bound and {target, source} <= numbers.keys()
        if known and result.exceeds(bound, energy, numbers[target], numbers[source]):
            raise InputError(
                f"{folder / PAIRS_FILE}: states a lower bound of {bound:.6g} for {target} - {source}, above its "
                f"energy {energy:.6g}"
            )
    return result


def _pair_rows(file: Path) -> dict[tuple[str, str], tuple[float, float]]:
    """Return the lower bound and the energy of every pair of the table, NaN where there is none."""
    rows: dict[tuple[str, str], tuple[float, float]] = {}
    try:
        for row in csv.DictReader(io.StringIO(read_text(file), newline="")):
            ends = plain_cell(row["target"]), plain_cell(row["source"])
            if ends in rows or ends[::-1] in rows:
                raise InputError(f"the pair {ends[0]} - {ends[1]} occurs twice")
            rows[ends] = float(row["lower_bound"] or "nan"), float(row["energy"] or "nan")
    except (ValueError, KeyError, TypeError, AttributeError, csv.Error) as error:
        raise InputError(f"{file}: cannot be read as a table of pairs ({error})") from None
    return rows


def _check_samples(folder: Path, result: _Result, shape: int, file: Path) -> None:
    """Refuse samples that are not those of the result, as the run centred and scaled them."""
    matched, placed = result.coordinates[shape, :, :3], result.positions[shape]
    linear = result.transforms[shape, :3, :3]
    try:
        own = (placed - placed.mean(axis=0)) @ np.linalg.inv(linear).T
    except np.linalg.LinAlgError:
        raise InputError(
            f"{folder / ALIGNMENT_FILE}: the transform of shape {shape} is singular"
        ) from None
    size = float(np.linalg.norm(own))
    unit = {"centroid": size, "none": 1.0}.get(
        result.normalisation, size / max(float(np.linalg.norm(matched)), 1e-300)
    )
    if result.normalisation not in ("centroid", "none"):
        mesh = read_shape(folder / MESH_FOLDER / f"{result.stems[shape]}.ply", AS_STORED)
        length = float(vertex_areas(mesh).sum()) ** 0.5 / abs(float(np.linalg.det(linear))) ** (
            1 / 3
        )
        unit = unit if abs((unit / length) ** 2 - 1.0) <= _AREA_TOL else float("nan")
    fits = np.abs(matched * unit - own).max() <= _SAMPLE_TOL * size
    if not (
        fits and 1.0 / LARGEST_COORDINATE <= size <= LARGEST_COORDINATE
    ):  # what vanishes fits everything
        raise InputError(
            f"{file}: the samples of shape {shape} are not those of "
            f"{CORRESPONDENCES_FILE}, centred and scaled; the certificates are about other shapes"
        )


def _load(file: Path, names: tuple[str, ...]) -> list[NDArray[Any]]:
    """Read arrays of an archive that is not trusted to be small or whole."""
    with open_regular(file, MAX_BYTES) as stream:
        arrays = load_arrays(stream.read(), str(file))
    missing = [name for name in names if name not in arrays]
    if missing:
        raise InputError(f"{file}: cannot be read, it has no array {missing[0]!r}")
    return [arrays[name] for name in names]
