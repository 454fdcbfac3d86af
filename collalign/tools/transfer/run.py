"""Landmarks of a few specimens carried to all others of an aligned collection, with calibrated error radii."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from collalign.confidence.radius_model import (
    MIN_TEMPLATES,
    Calibration,
    RadiusEvidence,
    beyond_range,
    calibrate,
    radii,
)
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory
from collalign.landmarks.carry import (
    Template,
    at_places,
    fuse,
    off_surface,
    on_surface,
    template,
    template_distance,
)
from collalign.landmarks.local_fit import Surroundings, fit_surroundings, holds
from collalign.landmarks.on_surface import place_templates
from collalign.landmarks.table import LandmarkTable, evenly_spaced, landmark_table
from collalign.landmarks.templates import (
    SemilandmarkKeywords,
    SemilandmarkRequest,
    read_templates,
    with_semilandmarks,
)
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.products.trust import DOUBT
from collalign.registration.surface import RegistrationSurface, nearest_on, with_cloud_rim
from collalign.tools.correspond import DenseCorrespondence, dense_correspondence
from data_tools.arrays import FloatArray, read_only
from data_tools.checks import as_options
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.io.shapes import CoordinateSystem, read_shape
from data_tools.landmark_files import Landmarks, SemilandmarkRows
from data_tools.names import by_known_names
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.poses import moved_by
from data_tools.surface.closest import lies_beyond
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

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
        0 for a template's own. With fewer than four templates, as on six other kinds of shapes where the surfaces
        around a landmark look like that.
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


#: What semilandmarks of the whole surface are called.
SURFACE = "surface"
#: Farthest points by which the size of a specimen is measured, which says how far from its rim it has nothing.
_NUM_RIM_POINTS = 300


@one_blas_thread()
def transfer_landmarks(
    result: Collection | str | Path,
    landmarks: Mapping[str, Landmarks] | Sequence[str | Path],
    *,
    semilandmarks: SemilandmarkRequest | Mapping[str, Any] | None = None,
    sources: str | Path | None = None,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
    **keywords: Unpack[SemilandmarkKeywords],
) -> TransferredLandmarks:
    """Carry landmarks from the specimens that have them to all others.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote.
    landmarks : mapping of name to Landmarks, or sequence of path
        In file coordinates, or in LPS or RAS where that is declared. A file ``A.mrk.json``, ``A.fcsv``, ``A.csv``
        or ``A.pts`` belongs to the shape called A, or to B as ``"B=A.csv"``; TPS, NTS and morphologika name their
        specimens.
        Markups of the type Curve and ClosedCurve are curves of semilandmarks.
    semilandmarks : SemilandmarkRequest or mapping, optional
    sources : path, optional
        Folder that holds the original files now, where they have moved.
    run : RunOptions, optional
    progress : bool or callable
        As in :func:`collalign.align_collection`.
    **keywords
        Fields of ``semilandmarks`` by themselves, which win: ``curves=["RIM/A.fcsv"]``, ``surface_points=500``.

    Raises
    ------
    InputError
        If a file belongs to no shape, its landmarks do not lie on that, or two templates have no landmark in common.
    CollectionError
        If the shapes cannot be registered.

    Notes
    -----
    Shapes of confidence below the result's threshold get no landmarks, incomplete ones none where they have nothing.

    Examples
    --------
    >>> import tempfile
    >>> from data_tools.datasets.synthetic import demo_collection, write_collection
    >>> from data_tools.landmark_files import Landmarks
    >>> planted = demo_collection(num=3, resolution=1)
    >>> marks = {"chair1": Landmarks(labels=("tip",), points=planted.shapes[0].vertices[:1])}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = write_collection(folder + "/shapes", planted)
    ...     files = collalign.align_collection(folder + "/shapes", progress=False).save(folder + "/result")
    ...     collalign.transfer_landmarks(folder + "/result", marks, progress=False).status[1]
    ('carried over',)
    """
    collection = load(result, sources=sources)
    wanted = as_options("semilandmarks", semilandmarks, SemilandmarkRequest, keywords)
    given = (
        dict(landmarks)
        if isinstance(landmarks, Mapping)
        else read_templates(landmarks, collection.names)
    )
    given = by_known_names(
        "landmarks", with_semilandmarks(given, wanted, collection.names), collection.names
    )
    rows = {name: collection.index(name) for name in given}
    meshes = tuple(
        (name, *mesh) for name, mesh in zip(collection.names, collection.surfaces, strict=True)
    )
    placed, notes, system = place_templates(
        given,
        {name: collection.file(at) for name, at in rows.items()},
        meshes,
        collection.options.cleaning,
    )
    transforms = {name: collection.transforms[at] for name, at in rows.items()}
    table = landmark_table(placed, transforms, curve_points=wanted.curve_points)
    dense = dense_correspondence(collection, run=run, progress=progress)
    found = LandmarkCarrier(collection, dense, table).run(wanted.surface_points)
    return replace(found, notes=(*notes, *table.notes), system=system)


class LandmarkCarrier:
    """Carries landmarks from templates to the other specimens of a collection.

    Parameters
    ----------
    collection : Collection
    dense : DenseCorrespondence
        Of its shapes.
    table : LandmarkTable
        Landmarks of the templates, at least one of which is registered.
    """

    def __init__(
        self, collection: Collection, dense: DenseCorrespondence, table: LandmarkTable
    ) -> None:
        self._collection, self._dense, self._labels, self._known = (
            collection,
            dense,
            table.labels,
            table.points,
        )
        self._semilandmarks = table.semilandmarks
        self._rows = {name: row for row, name in enumerate(dense.names)}
        centred = dense.mean - dense.mean.mean(axis=0)
        self._radius = radius = float(np.sqrt((centred**2).sum(axis=1).mean()))
        self.templates: list[Template] = []
        self._around: dict[int, Surroundings] = {}
        for name, points in table.points.items():
            if name in self._rows:
                item, around = self._read_template(name, points)
                self.templates.append(item)
                self._around[item.shape] = around
        if not self.templates:
            raise InputError("landmarks: none of the specimens with landmarks could be registered")
        copies = [(item, dense.completed[item.shape]) for item in self.templates]
        self._holds = {
            item.shape: holds(item.places.on(copy), copy, dense.faces, radius)
            for item, copy in copies
        }
        self._variation = float(np.sqrt(((dense.completed - dense.mean) ** 2).sum(axis=2).mean()))
        self._scale = {
            name: float(scale)
            for name, scale in zip(collection.names, collection.scales, strict=True)
        }

    def run(self, surface_points: int) -> TransferredLandmarks:
        """Predict every specimen, and every template from the others; and spread points over all surfaces."""
        errors, evidence = self._leave_one_out()
        calibration = calibrate(errors, evidence)
        found = [self._specimen(name, calibration) for name in self._collection.names]
        names = tuple(self._dense.names[item.shape] for item in self.templates)
        unit = np.array([self._scale[name] for name in names])[:, None]
        rest = [evidence[:at] + evidence[at + 1 :] for at in range(len(evidence))]
        without = [calibrate(np.delete(errors, at, 0), others) for at, others in enumerate(rest)]
        radius = np.array([radii(one, own) for one, own in zip(without, evidence, strict=True)])
        carried = TransferredLandmarks(
            names=self._collection.names,
            labels=self._labels,
            points=read_only(np.stack([points for points, _, _ in found])),
            radii=read_only(np.stack([radius for _, radius, _ in found])),
            status=tuple(status for _, _, status in found),
            templates=names,
            left_out_errors=read_only(errors / unit),
            left_out_radii=read_only(radius / unit),
            semilandmarks=self._semilandmarks,
        )
        return self._with_surface_points(carried, surface_points) if surface_points else carried

    def _leave_one_out(self) -> tuple[FloatArray, list[RadiusEvidence]]:
        """Return errors (t, l) of templates predicted from the others, in the common frame, and their evidence."""
        shape = (len(self.templates), len(self._labels))
        if len(self.templates) < 2:
            nothing = np.full(shape[1], np.nan)
            return np.full(shape, np.nan), [
                RadiusEvidence(
                    spread=nothing,
                    distance=0.0,
                    residual=nothing,
                    unit=1.0,
                    variation=0.0,
                    hold=nothing,
                    slip=nothing,
                    misfit=nothing,
                )
            ]
        errors, evidence = [], []
        for at, item in enumerate(self.templates):
            name = self._dense.names[item.shape]
            points, shown, _ = self.predict(name, self.templates[:at] + self.templates[at + 1 :])
            errors.append(self.errors(name, points))
            evidence.append(shown)
        return np.array(errors), evidence

    def _specimen(
        self, name: str, calibration: Calibration
    ) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
        """Return points and radii in the file's unit and what became of each landmark."""
        own = self._known.get(name, np.full((len(self._labels), 3), np.nan))
        placed = np.isfinite(own).all(axis=1)
        points, radius = np.array(own), np.where(placed, 0.0, np.nan)
        reason = self._abstention(name)
        known = (
            np.isfinite(np.stack([item.offsets for item in self.templates])).all(axis=2).any(axis=0)
        )
        reasons = np.where(known, MISSING_PLACE, UNKNOWN)
        if reason is None and not placed.all():
            predicted, evidence, lost = self.predict(name, self.templates)
            vague = beyond_range(calibration, evidence)
            predicted[(lost != "") | vague] = np.nan
            reasons = np.where(lost != "", lost, np.where(vague, OUT_OF_RANGE, reasons))
            inverse = np.linalg.inv(self._collection.transforms[self._collection.index(name)])
            points[~placed] = moved_by(inverse, predicted)[~placed]
            radius[~placed] = radii(calibration, evidence)[~placed] / self._scale[name]
            radius[np.isnan(points).any(axis=1)] = np.nan
        there = np.isfinite(points).all(axis=1)
        words = np.where(placed, PLACED, np.where(there, CARRIED, reason or reasons))
        return points, radius, tuple(words.tolist())

    def _abstention(self, name: str) -> str | None:
        if name not in self._rows:
            return NOT_REGISTERED
        doubtful = self._collection.confidence[self._collection.index(name)] < DOUBT
        return DOUBTFUL_POSE if doubtful else None

    def predict(
        self, name: str, templates: list[Template]
    ) -> tuple[FloatArray, RadiusEvidence, NDArray[np.str_]]:
        """Predict the landmarks of a specimen from some templates.

        Returns
        -------
        points : ndarray, shape (l, 3)
            In the common frame.
        evidence : RadiusEvidence
        lost : ndarray of str, shape (l,)
            Why a landmark has no place on the specimen's surface; empty where it has one.
        """
        row, dense = self._rows[name], self._dense
        points, spreads = fuse(templates, row, dense.vertices, dense.quality)
        surface = self._surface(name)
        lost = np.where(off_surface(templates), "", _lost(surface, points))
        placed = on_surface(points, templates, surface.locator)
        for curve in self._semilandmarks:
            rows = list(curve.rows)
            if curve.kind != "patch" and np.isfinite(placed[rows]).all():
                spaced = evenly_spaced(placed[rows], len(rows), closed=curve.kind == "closed curve")
                placed[rows] = on_surface(
                    spaced, [item.only(rows) for item in templates], surface.locator
                )
        slip, misfit = self._local_fits(templates, row, placed, surface)
        evidence = RadiusEvidence(
            spread=spreads,
            distance=template_distance(templates, row, dense.vertices),
            residual=at_places(templates, dense.residual[row]).mean(axis=0),
            unit=self._radius,
            variation=self._variation,
            hold=self._mean_known(templates, [self._holds[item.shape] for item in templates]),
            slip=slip,
            misfit=misfit,
        )
        return placed, evidence, lost

    def errors(self, name: str, points: FloatArray) -> FloatArray:
        """Return how far predicted landmarks are from a template's own, in the common frame, shape (l,)."""
        return np.asarray(np.linalg.norm(points - self._posed(name, self._known[name]), axis=1))

    def _read_template(self, name: str, points: FloatArray) -> tuple[Template, Surroundings]:
        """Return a template and the surroundings of its landmarks, which are points (l, 3) of its file."""
        row, mean = self._rows[name], self._dense.mean
        surface, posed = self._surface(name), self._posed(name, points)
        item = template(
            row, posed, self._dense.completed[row], self._dense.faces, self._radius, surface.locator
        )
        return item, Surroundings.of(
            posed, item.places.on(mean), surface.vertices, mean, self._radius
        )

    def _local_fits(
        self,
        templates: list[Template],
        row: int,
        placed: FloatArray,
        surface: RegistrationSurface,
    ) -> tuple[FloatArray, FloatArray]:
        """Return slip and misfit of :class:`RadiusEvidence`, shape (l,) each."""
        if len(templates) >= MIN_TEMPLATES:
            return np.full(len(placed), np.nan), np.full(len(placed), np.nan)
        copies, normals = self._dense.completed, surface.normals(surface.vertices)
        fits = [
            fit_surroundings(
                self._around[item.shape],
                copies[item.shape],
                copies[row],
                surface.locator,
                normals,
                self._radius,
            )
            for item in templates
        ]
        slips = [np.linalg.norm(places - placed, axis=1) for places, _ in fits]
        return self._mean_known(templates, slips), self._mean_known(
            templates, [misfits for _, misfits in fits]
        )

    @staticmethod
    def _mean_known(templates: list[Template], values: list[FloatArray]) -> FloatArray:
        """Return the mean of values (l,) of templates over those that have the landmark, shape (l,)."""
        known = np.stack([np.isfinite(item.offsets).all(axis=1) for item in templates])
        total = np.where(known, np.stack(values), 0.0).sum(axis=0)
        return np.asarray(total / np.maximum(known.sum(axis=0), 1))

    def _with_surface_points(self, carried: TransferredLandmarks, num: int) -> TransferredLandmarks:
        """Add evenly spread vertices of the mean, on the surface of every shape."""
        mean = Shape.from_arrays(self._dense.mean, self._dense.faces, name="the mean")
        if num > len(mean.vertices):
            raise InputError(
                f"surface_points: the mean has {len(mean.vertices)} vertices, {num} are asked for"
            )
        chosen = farthest_points(mean, num, metric="euclidean")
        places, words = [], []
        for at, name in enumerate(self._collection.names):
            reason = self._abstention(name)
            points, lost = np.full((num, 3), np.nan), np.full(num, reason or "")
            if reason is None:
                copies = self._dense.vertices[self._rows[name]][chosen]
                surface = self._surface(name)
                lost = _lost(surface, copies)
                there = np.isfinite(copies).all(axis=1) & (lost == "")
                points[there] = surface.locator.closest(copies[there]).on(surface.vertices)
                points = moved_by(np.linalg.inv(self._collection.transforms[at]), points)
            places.append(points)
            why = np.where(lost == "", NO_COUNTERPART, lost)
            words.append(np.where(np.isfinite(points).all(axis=1), CARRIED, why).tolist())
        rows = SemilandmarkRows(
            SURFACE, "patch", tuple(range(len(self._labels), len(self._labels) + num))
        )
        nothing = np.full((len(self._collection.names), num), np.nan)
        left_out = np.full((len(carried.templates), num), np.nan)
        return replace(
            carried,
            labels=(*self._labels, *(f"{SURFACE}-{number}" for number in range(1, num + 1))),
            points=read_only(np.concatenate([carried.points, np.stack(places)], axis=1)),
            radii=read_only(np.concatenate([carried.radii, nothing], axis=1)),
            status=tuple((*own, *more) for own, more in zip(carried.status, words, strict=True)),
            left_out_errors=read_only(np.concatenate([carried.left_out_errors, left_out], axis=1)),
            left_out_radii=read_only(np.concatenate([carried.left_out_radii, left_out], axis=1)),
            semilandmarks=(*self._semilandmarks, rows),
        )

    def _surface(self, name: str) -> RegistrationSurface:
        """Read a specimen's surface, as its file has it, in the common frame."""
        at = self._collection.index(name)
        cleaning = CleaningOptions(inner=self._collection.options.cleaning.inner)
        shape = read_shape(self._collection.file(at), cleaning, name=name).transformed(
            self._collection.transforms[at]
        )
        return with_cloud_rim(RegistrationSurface.from_shape(shape, _NUM_RIM_POINTS))

    def _posed(self, name: str, points: FloatArray) -> FloatArray:
        return moved_by(self._collection.transforms[self._collection.index(name)], points)


def _lost(surface: RegistrationSurface, points: FloatArray) -> NDArray[np.str_]:
    """Return why points that are known have no place on a surface, shape (l,); empty where they have one."""
    known = np.asarray(np.isfinite(points).all(axis=1))
    distances, on_rim = nearest_on(surface, np.where(known[:, None], points, surface.vertices[0]))
    beyond = known & lies_beyond(distances, on_rim, surface.radius)
    return np.where(beyond, np.where(on_rim, NO_COUNTERPART, NOT_REACHED), "")
