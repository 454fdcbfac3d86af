"""Landmarks of all specimens as a transfer returns them, and what became of each."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.arrays import FloatArray
from data_tools.io.shapes import CoordinateSystem
from data_tools.landmark_files import SemilandmarkRows
from data_tools.notes import Note

#: What became of a landmark.
(
    PLACED,
    CARRIED,
    DOUBTFUL_POSE,
    NOT_REGISTERED,
    UNKNOWN,
    MISSING_PLACE,
    NO_COUNTERPART,
    NOT_REACHED,
    OUT_OF_RANGE,
    CONTRADICTED,
) = (
    "placed by an expert",
    "carried over",
    "abstained: the pose is doubtful",
    "abstained: the shape is not registered",
    "abstained: no template has it",
    "missing: the shape is incomplete there",
    "abstained: the surface ends before it",
    "abstained: the mean surface does not reach the specimen there",
    "abstained: the surface fits worse there than on any template",
    "abstained: the templates have this landmark in different orders",
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
        0 for a template's own. With fewer than four templates, as on other kinds of shapes where the surfaces around
        a landmark look like that.
    ellipsoids : ndarray, shape (N, l, 3, 3)
        Semi-axes of ellipsoids, which hold nine of ten landmarks as well. Rows are vectors in file coordinates,
        longest first: along the direction in which the surface tells the place least, across it, and about along the
        normal. 0 for a template's own; NaN where there is no radius.
    status : tuple of tuple of str
        What became of each landmark of each shape.
    templates : tuple of str
    template_trust : ndarray, shape (t, l)
        How far each template counts at each landmark: 1 fully, 0 where it has none or the others contradict it.
    left_out_points : ndarray, shape (t, l, 3)
        Where the other templates predict each template's landmarks, in the coordinates of its file; NaN with one
        template.
    left_out_errors : ndarray, shape (t, l)
        Distance of each template's landmark from there.
    left_out_radii : ndarray, shape (t, l)
        What was predicted for them, calibrated on the other templates alone.
    semilandmarks : tuple of SemilandmarkRows
        Which landmarks are on curves and patches.
    notes : tuple of Note
        What is known of the templates' coordinates, of landmarks off their surface, and what templates disagree on.
    system : {"LPS", "RAS"}
        What the landmarks say of the shapes' coordinates, where their files declare nothing.
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]
    points: FloatArray
    radii: FloatArray
    ellipsoids: FloatArray
    status: tuple[tuple[str, ...], ...]
    templates: tuple[str, ...]
    template_trust: FloatArray
    left_out_points: FloatArray
    left_out_errors: FloatArray
    left_out_radii: FloatArray
    semilandmarks: tuple[SemilandmarkRows, ...] = ()
    notes: tuple[Note, ...] = ()
    system: CoordinateSystem = "LPS"
