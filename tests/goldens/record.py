"""What is kept of a result: hashes of every file's contents, and values that another processor gives as well."""

import csv
import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign import align_collection
from collalign.output.evidence_file import CORRESPONDENCES_FILE
from collalign.output.vertex_maps import VERTEX_MAPS_FILE
from collalign.output.write import ALIGNMENT_FILE, PAIRS_FILE
from tests.commands import read_json

STORED = Path(__file__).parent / "stored"
SAMPLING = {"num_points": 24, "num_dense_points": 200}
#: Not parts of the result: the version, and the options, of which there may be more one day.
LEFT_OUT = ("version", "options")
#: Most values that are kept of one array, evenly spaced.
MOST_VALUES = 120
#: Values are compared to this fraction of their size, or of 1 where they are smaller. Linear algebra for four other
#: kinds of processor moved one value by .005, a margin that depends on a tie, and no other by .001.
TOLERANCE = 1e-2
#: Digits of the values that are kept.
DIGITS = 5


@dataclass(frozen=True)
class Record:
    """A result: a hash of the shapes and of each file, and the values of the files."""

    hashes: dict[str, str]
    values: dict[str, Any]


def aligned_record(golden, folder):
    """Align a collection in an empty folder and return the record of what was written."""
    golden.write(folder / "shapes")
    collection = align_collection(
        folder / "shapes", sampling=SAMPLING, seed=0, jobs=1, progress=False, **golden.keywords
    )
    collection.save(folder / "out", report=False)
    return record_of(folder / "shapes", folder / "out")


def record_of(shapes, out):
    """Return the record of a result and the folder of its shapes."""
    alignment = read_json(out / ALIGNMENT_FILE)
    alignment = {name: value for name, value in alignment.items() if name not in LEFT_OUT}
    table = (out / PAIRS_FILE).read_text()
    pairs = [
        {name: _number(cell) for name, cell in row.items()}
        for row in csv.DictReader(table.splitlines())
    ]
    hashes = {
        "shapes": _hash(*(file.read_bytes() for file in sorted(shapes.iterdir()))),
        ALIGNMENT_FILE: _hash(json.dumps(alignment).encode()),
        PAIRS_FILE: _hash(table.encode()),
    }
    values = {ALIGNMENT_FILE: alignment, PAIRS_FILE: pairs}
    for name in (CORRESPONDENCES_FILE, VERTEX_MAPS_FILE):
        if (out / name).exists():
            with np.load(out / name) as arrays:
                found = {key: arrays[key] for key in sorted(arrays)}
            hashes[name] = _hash(
                *(part for key, array in found.items() for part in _contents(key, array))
            )
            values[name] = {key: _some_values(array) for key, array in found.items()}
    return Record(hashes, values)


def load_record(name):
    """Return the stored record of a collection."""
    return Record(**read_json(STORED / f"{name}.json"))


def store_record(name, record):
    """Store the record of a collection, its numbers rounded."""
    STORED.mkdir(exist_ok=True)
    content = asdict(Record(record.hashes, _rounded(record.values)))
    (STORED / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")


def changed_files(stored, found):
    """Return the names of the files whose contents have another hash, or are there in one record only."""
    return [
        name
        for name in stored.hashes | found.hashes
        if stored.hashes.get(name) != found.hashes.get(name)
    ]


def differences(stored, found, place=""):
    """Return a line for each value that differs by more than the tolerance, or is not there."""
    if isinstance(stored, dict) and isinstance(found, dict):
        missing = [
            f"{place}/{name}: only in one of the two"
            for name in sorted(stored.keys() ^ found.keys())
        ]
        both = [
            differences(stored[name], found[name], f"{place}/{name}")
            for name in stored
            if name in found
        ]
        return [*missing, *(line for lines in both for line in lines)]
    if isinstance(stored, list) and isinstance(found, list) and len(stored) == len(found):
        both = [
            differences(*pair, f"{place}/{i}")
            for i, pair in enumerate(zip(stored, found, strict=True))
        ]
        return [line for lines in both for line in lines]
    if _is_number(stored) and _is_number(found):
        same = math.isclose(stored, found, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
        same = same or (math.isnan(stored) and math.isnan(found))
    else:
        same = type(stored) is type(found) and stored == found
    return [] if same else [f"{place}: {stored!r} stored, {found!r} found"]


def _is_number(value):
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(cell):
    """Return a cell of a table as a number where it is one."""
    try:
        return float(cell)
    except ValueError:
        return cell


def _hash(*contents):
    digest = hashlib.sha256()
    for content in contents:
        digest.update(content)
    return digest.hexdigest()[:16]


def _contents(name, array):
    return (
        name.encode(),
        f"{array.dtype.str}{array.shape}".encode(),
        np.ascontiguousarray(array).tobytes(),
    )


def _some_values(array):
    step = max(1, math.ceil(array.size / MOST_VALUES))
    return {"shape": list(array.shape), "values": array.ravel()[::step].tolist()}


def _rounded(value):
    if isinstance(value, dict):
        return {name: _rounded(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return round(value, DIGITS) if isinstance(value, float) else value
