"""Tables of the whole result, as CSV and Parquet, for R, pandas and spreadsheets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from collalign.confidence.candidate_model import candidate_chances
from collalign.output.collection import Collection
from collalign.tools.export.request import (
    ExportRequest,
    label_columns,
    member_columns,
)
from data_tools.errors import UnavailableError
from data_tools.io.text_tables import csv_text

#: Column name to values.
Table = Mapping[str, Sequence[Any]]


def write_csv(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``shapes.csv`` and ``landmarks.csv``, the latter in the space asked for."""
    tables = {"shapes": shape_columns(request), "landmarks": landmark_columns(request)}
    return tuple(
        request.write(f"{name}.csv", csv_text([table, *zip(*table.values(), strict=True)]))
        for name, table in tables.items()
    )


def shape_columns(request: ExportRequest) -> Table:
    """Return the table of all shapes: pose, size, confidence, why a shape does not count, labels."""
    collection = request.collection
    entries: list[list[float]] = (
        collection.transforms[:, :3].reshape(len(collection), 12).T.tolist()
    )
    columns: dict[str, list[Any]] = {
        "name": list(collection.names),
        "file": list(collection.files),
        "relative_path": list(collection.relative_paths),
        "digest": list(collection.digests),
        "confidence": collection.confidence.tolist(),
        "reflected": collection.reflected.astype(int).tolist(),
        "group": collection.part_numbers.tolist(),
        "kind": list(collection.kind_names),
        "alone": collection.is_alone.astype(int).tolist(),
        "centroid_size_landmarks": collection.centroid_sizes.tolist(),
        "scale": collection.scales.tolist(),
        **member_columns(request),
        **{f"T{at // 4 + 1}{at % 4 + 1}": column for at, column in enumerate(entries)},
    }
    return columns | label_columns(collection, columns)


def landmark_columns(request: ExportRequest) -> Table:
    """Return the landmarks of all shapes, one row each, in the space asked for."""
    labels, coordinates = request.landmarks()
    names = request.collection.names
    x, y, z = coordinates.reshape(-1, 3).T.tolist()
    return {
        "name": [name for name in names for _ in labels],
        "landmark": list(labels) * len(names),
        "x": x,
        "y": y,
        "z": z,
    }


#: Rows that a reader gets at a time.
_GROUP_ROWS = 50_000


def write_parquet(request: ExportRequest) -> tuple[Path, ...]:
    """Write ``shapes.parquet``, ``landmarks.parquet`` and ``pairs.parquet``.

    Shapes and landmarks have the columns of the CSV tables, pairs those of ``pairs.csv`` that say what was decided.
    Rows come in groups of 50 000, so that Arrow, DuckDB, pandas and others read a part, or one column.

    Raises
    ------
    UnavailableError
        If pyarrow is not installed.
    """
    tables = {
        "shapes": shape_columns(request),
        "landmarks": landmark_columns(request),
        "pairs": _pair_columns(request.collection),
    }
    return tuple(
        _write_table(request.path(f"{name}.parquet"), table) for name, table in tables.items()
    )


def _pair_columns(collection: Collection) -> Table:
    pairs, names = collection.pairs, collection.names
    chances = [
        float(candidate_chances(pair)[pair.choice]) if pair.choice >= 0 else float("nan")
        for pair in pairs
    ]
    return {
        "target": [names[pair.target] for pair in pairs],
        "source": [names[pair.source] for pair in pairs],
        "energy": [pair.energy for pair in pairs],
        "lower_bound": [pair.lower_bound for pair in pairs],
        "status": [pair.status for pair in pairs],
        "choice": [pair.choice for pair in pairs],
        "inlier": [pair.inlier for pair in pairs],
        "disagreement_deg": [pair.disagreement_deg for pair in pairs],
        "chance": chances,
    }


def _write_table(path: Path, table: Table) -> Path:
    arrow, parquet = _arrow()
    columns = {name: [_encodable(value) for value in values] for name, values in table.items()}
    parquet.write_table(arrow.table(columns), path, row_group_size=_GROUP_ROWS)
    return path


def _encodable(value: Any) -> Any:
    """Return a value whose text UTF-8 can hold: names of files may be no text."""
    return value.encode("utf-8", "backslashreplace").decode() if isinstance(value, str) else value


def _arrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise UnavailableError(
            "format parquet needs pyarrow, which is not installed; run: pip install 'collalign[parquet]'"
        ) from error
    return pyarrow, pyarrow.parquet
