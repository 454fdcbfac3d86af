"""Tables of the whole result, as CSV and Parquet, for R, pandas and spreadsheets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from collalign.analysis.procrustes import (
    generalized_procrustes,
    principal_components,
    procrustes_distances,
)
from collalign.confidence.candidate_model import candidate_chances
from collalign.output.collection import Collection
from collalign.tools.export.request import (
    ExportRequest,
    complete_labels,
    label_columns,
    member_columns,
)
from data_tools.errors import InputError, UnavailableError
from data_tools.io.text_tables import csv_text

#: Column name to values.
Table = Mapping[str, Sequence[Any]]


def write_csv(request: ExportRequest) -> tuple[Path, ...]:
    """Write every table as ``NAME.csv``."""
    return tuple(
        request.write(f"{name}.csv", csv_text([table, *zip(*table.values(), strict=True)]))
        for name, table in result_tables(request).items()
    )


def result_tables(request: ExportRequest) -> dict[str, Table]:
    """Return all tables of a result.

    ``shapes`` (pose, size, confidence, why it does not count, labels), ``landmarks`` (long form, in the space asked
    for) have rows of all shapes. Of those who count are ``consensus`` (means of landmarks),
    ``procrustes_distances``, and where they have enough landmarks in common ``procrustes_coordinates`` (a row per
    shape, columns L1_x, L1_y, ...: ``geomorph::arrayspecs`` makes an array of it) and ``principal_components``.
    """
    counted = request.counted
    tables: dict[str, Table] = {
        "shapes": shape_columns(request),
        "landmarks": landmark_columns(request),
    }
    if not len(counted.collection):
        return tables
    tables |= {"consensus": _consensus(counted), "procrustes_distances": _distances(counted)}
    try:
        common = complete_labels(counted.collection)
    except InputError:
        return tables
    superimposed = generalized_procrustes(counted.collection.aligned_landmarks[:, common])
    labels = [
        f"{counted.collection.landmark_names[at]}_{axis}"
        for at in np.flatnonzero(common)
        for axis in "xyz"
    ]
    flat = superimposed.reshape(len(superimposed), -1)
    names = list(counted.collection.names)
    tables["procrustes_coordinates"] = {"name": names} | dict(
        zip(labels, flat.T.tolist(), strict=True)
    )
    if len(names) > 1:
        scores = principal_components(superimposed).scores
        tables["principal_components"] = {"name": names} | {
            f"PC{at + 1}": s.tolist() for at, s in enumerate(scores.T)
        }
    return tables


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


def _consensus(request: ExportRequest) -> Table:
    """Return the mean of every landmark over the shapes that have it, in the space asked for."""
    labels, coordinates = request.landmarks()
    known = np.asarray(~np.isnan(coordinates).any(axis=2))
    counts = known.sum(axis=0)
    totals = np.where(known[..., None], coordinates, 0.0).sum(axis=0)
    means = np.where(counts[:, None] > 0, totals / np.maximum(counts, 1)[:, None], np.nan)
    x, y, z = means.T.tolist()
    return {"landmark": list(labels), "shapes": counts.tolist(), "x": x, "y": y, "z": z}


def _distances(request: ExportRequest) -> Table:
    distances = procrustes_distances(request.collection.aligned_landmarks)
    columns = dict(zip(request.collection.names, distances.T.tolist(), strict=True))
    return {"": list(request.collection.names)} | columns


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
