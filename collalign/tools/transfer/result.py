"""Landmarks carried from a few specimens to a whole collection."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.arrays import FloatArray
from data_tools.io.coordinate_systems import CoordinateSystem
from data_tools.landmarks.landmark_files import SemilandmarkRows
from data_tools.notes import Note

#: What became of a landmark.
PLACED, CARRIED, DOUBTFUL_POSE, NOT_REGISTERED, UNKNOWN, MISSING_PLACE, NO_COUNTERPART, OUT_OF_RANGE = (
    "placed by an expert",
    "carried over",
    "abstained: the pose is doubtful",
    "abstained: the shape is not registered",
    "abstained: no template has it",
    "missing: the shape is incomplete there",
    "abstained: the surface ends before it",
    "abstained: the surface fits worse there than on any template",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class TransferredLandmarks:
    """Landmarks on every specimen. Arrays are read-only, lengths in the unit of each specimen's file.

    Attributes
    ----------
    names : tuple of str, length N
        All shapes of the collection.
    labels : tuple of str, length l
    points : ndarray, shape (N, l, 3)
        In file coordinates; NaN where the transfer abstained, or an incomplete shape has no such place. A template
        keeps its own.
    radii : ndarray, shape (N, l)
        Nine of ten landmarks are at most so far from where an expert would put them, on specimens like the templates;
        0 for a template's own. With fewer than four templates, as on molars and mouse skulls whose surface around a
        landmark looks like that.
    status : tuple of tuple of str
        What became of each landmark of each shape.
    templates : tuple of str
    left_out_errors : ndarray, shape (t, l)
        Distance of each template's landmark from the one predicted by the other templates; NaN with one template.
    left_out_radii : ndarray, shape (t, l)
        What was predicted for them, calibrated on the other templates alone.
    semilandmarks : tuple of SemilandmarkRows
        Which landmarks are on curves and patches.
    notes : tuple of Note
        What is known of the templates' coordinates, and of landmarks off their surface.
    system : {"LPS", "RAS"}
        What the landmarks say of the shapes' coordinates, where their files declare nothing.
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]
    points: FloatArray
    radii: FloatArray
    status: tuple[tuple[str, ...], ...]
    templates: tuple[str, ...]
    left_out_errors: FloatArray
    left_out_radii: FloatArray
    semilandmarks: tuple[SemilandmarkRows, ...] = ()
    notes: tuple[Note, ...] = ()
    system: CoordinateSystem = "LPS"
