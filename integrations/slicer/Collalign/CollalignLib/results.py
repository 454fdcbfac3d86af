"""Reads the output folder of ``collalign align``: transforms in Slicer's coordinates, doubts, points."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

#: Poses below this confidence are in doubt, as in the report.
DOUBT = 0.95
#: Model files are in LPS, as Slicer reads those that do not declare RAS; its scene is in RAS.
LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class AlignedShape:
    """One shape of an aligned collection.

    Attributes
    ----------
    name : str
    mesh : Path or None
        The aligned mesh that the run wrote, in the common frame; None if it wrote none.
    transform : ndarray, shape (4, 4)
        From the coordinates of the original file, as Slicer shows it (RAS), to the common frame (RAS).
    confidence : float
        NaN where it is not known.
    points : ndarray, shape (k, 3)
        Corresponding points in the common frame (RAS), in the order of their labels; an incomplete shape has fewer.
    """

    name: str
    mesh: Path | None
    transform: np.ndarray
    confidence: float
    points: np.ndarray

    @property
    def in_doubt(self) -> bool:
        """Whether the pose needs a look."""
        return not self.confidence >= DOUBT

    @property
    def percent(self) -> str:
        """The confidence in whole percent, rounded down, as the report says it."""
        return (
            "unknown"
            if math.isnan(self.confidence)
            else f"{math.floor(100 * self.confidence + 1e-9)} %"
        )


@dataclass(frozen=True)
class Results:
    """An aligned collection.

    Attributes
    ----------
    shapes : tuple of AlignedShape
    notes : tuple of str
        What must be known before the poses are trusted.
    """

    shapes: tuple[AlignedShape, ...]
    notes: tuple[str, ...]


def read_results(folder: Path) -> Results:
    """Read an output folder.

    Raises
    ------
    ValueError
        If it holds no result, or its files are of different runs.
    """
    try:
        record = json.loads((folder / "alignment.json").read_text(encoding="utf-8"))
        with np.load(folder / "correspondences.npz", allow_pickle=False) as archive:
            names, labels, positions = (archive[key] for key in ("names", "labels", "positions"))
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"{folder}: not the output of collalign align ({error})") from error
    if [shape["name"] for shape in record["shapes"]] != names.tolist():
        raise ValueError(f"{folder}: alignment.json and correspondences.npz are of different runs")
    meshes = {path.stem: path for path in sorted((folder / "meshes").glob("*"))}
    shapes = tuple(
        AlignedShape(
            name=shape["name"],
            mesh=meshes.get(shape["name"]),
            transform=to_ras(
                np.array(shape["transform"], dtype=float), shape.get("coordinate_system", "LPS")
            ),
            confidence=float("nan") if shape["confidence"] is None else float(shape["confidence"]),
            points=points[np.argsort(order)][(order < 0).sum() :] * np.diag(LPS_TO_RAS)[:3],
        )
        for shape, order, points in zip(record["shapes"], labels, positions, strict=True)
    )
    return Results(shapes=shapes, notes=tuple(note["text"] for note in record["notes"]))


def to_ras(transform: np.ndarray, system: str) -> np.ndarray:
    """Return a transform of a file's coordinates (LPS or RAS) to the common frame as one in RAS, shape (4, 4)."""
    return LPS_TO_RAS @ transform @ (np.eye(4) if system == "RAS" else LPS_TO_RAS)
