"""Landmarks of a few specimens carried to all others of an aligned collection, with calibrated error radii."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from collalign.dense import dense_correspondence
from collalign.engine.options import RunOptions
from collalign.engine.session import ProgressFactory
from collalign.landmarks.carry import Template, at_places, on_surface, template
from collalign.landmarks.fusion import fuse, template_distance
from collalign.landmarks.radii import Calibration, Evidence, calibrate, radii
from collalign.output.evidence.file import load_view
from collalign.products.collection import DOUBT
from collalign.products.dense import DenseCorrespondence
from collalign.products.evidence import CollectionView
from collalign.products.transfer import (
    CARRIED,
    DOUBTFUL_POSE,
    MISSING_PLACE,
    NOT_REGISTERED,
    PLACED,
    UNKNOWN,
    TransferredLandmarks,
)
from collalign.registration.options import RegistrationOptions
from data_tools.arrays import FloatArray, read_only
from data_tools.errors import InputError
from data_tools.io.landmarks import Landmarks, read_landmarks, specimen_of
from data_tools.io.shapes import read_shape
from data_tools.surface.closest import SurfaceLocator
from data_tools.threads import one_blas_thread


@one_blas_thread()
def transfer_landmarks(
    result: str | Path,
    landmarks: Mapping[str, Landmarks] | Sequence[str | Path],
    *,
    options: RegistrationOptions | None = None,
    run: RunOptions | None = None,
    progress: ProgressFactory | bool = True,
) -> TransferredLandmarks:
    """Carry landmarks from the specimens that have them to all others.

    Parameters
    ----------
    result : path
        Folder that ``collalign align`` wrote.
    landmarks : mapping of name to Landmarks, or sequence of path
        In file coordinates. A file ``A.mrk.json``, ``A.fcsv`` or ``A.csv`` belongs to the shape called A.
    options : RegistrationOptions, optional
    run : RunOptions, optional
    progress : bool or callable
        As in :func:`collalign.align_collection`.

    Raises
    ------
    InputError
        If a file belongs to no shape, or two templates have no landmark in common.
    CollectionError
        If the shapes cannot be registered.

    Notes
    -----
    Shapes of confidence below the result's threshold get no landmarks, incomplete ones none where they have nothing.

    Examples
    --------
    >>> import tempfile
    >>> from data_tools.datasets.synthetic import demo_collection, write_collection
    >>> from data_tools.io.landmarks import Landmarks
    >>> planted = demo_collection(num=3, resolution=1)
    >>> marks = {"chair1": Landmarks(labels=("tip",), points=planted.shapes[0].vertices[:1])}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = write_collection(folder + "/shapes", planted)
    ...     files = collalign.align_collection(folder + "/shapes", progress=False).save(folder + "/result")
    ...     collalign.transfer_landmarks(folder + "/result", marks, progress=False).status[1]
    ('carried over',)
    """
    view = load_view(result)
    given = landmarks if isinstance(landmarks, Mapping) else read_templates(landmarks)
    labels, known = template_points(view, given)
    dense = dense_correspondence(result, options=options, run=run, progress=progress)
    return _Transfer(view, dense, labels, known).run()


def read_templates(paths: Sequence[str | Path]) -> dict[str, Landmarks]:
    """Read landmark files; the shape that each belongs to is the file's name without its suffix.

    Raises
    ------
    InputError
        If a file cannot be read or two belong to one shape.
    """
    read: dict[str, Landmarks] = {}
    for path in map(Path, paths):
        name = specimen_of(path)
        if name in read:
            raise InputError(f"{path}: a second landmark file of the specimen {name!r}")
        read[name] = read_landmarks(path)
    return read


def template_points(
    view: CollectionView, given: Mapping[str, Landmarks]
) -> tuple[tuple[str, ...], dict[str, FloatArray]]:
    """Return the labels of all templates together and each template's landmarks in that order, NaN where it has none.

    Raises
    ------
    InputError
        If there is no template, one belongs to no shape, names a landmark twice, or shares none with the first.
    """
    if not given:
        raise InputError("landmarks: no landmark file is given")
    labels = tuple(dict.fromkeys(label for marks in given.values() for label in marks.labels))
    points: dict[str, FloatArray] = {}
    for name, marks in given.items():
        view.index(name)
        if len(set(marks.labels)) < len(marks.labels):
            twice = next(label for label in marks.labels if marks.labels.count(label) > 1)
            raise InputError(f"{name}: two landmarks are called {twice!r}; give each a name of its own")
        first = next(iter(given.values()))
        if not set(marks.labels) & set(first.labels):
            raise InputError(f"{name}: none of its landmarks is called as any of {next(iter(given))}")
        points[name] = np.full((len(labels), 3), np.nan)
        points[name][[labels.index(label) for label in marks.labels]] = marks.points
    return labels, points


class _Transfer:
    """One transfer: the collection, its dense correspondence, and the templates on it."""

    def __init__(
        self, view: CollectionView, dense: DenseCorrespondence, labels: tuple[str, ...], known: dict[str, FloatArray]
    ) -> None:
        self._view, self._dense, self._labels, self._known = view, dense, labels, known
        self._rows = {name: row for row, name in enumerate(dense.names)}
        centred = dense.mean - dense.mean.mean(axis=0)
        self._radius = radius = float(np.sqrt((centred**2).sum(axis=1).mean()))
        self._templates = [
            template(
                self._rows[name], self._posed(name, points), dense.completed[self._rows[name]], dense.faces, radius
            )
            for name, points in known.items()
            if name in self._rows
        ]
        if not self._templates:
            raise InputError("landmarks: none of the specimens with landmarks could be registered")
        self._scale = {name: float(scale) for name, scale in zip(view.names, view.scales, strict=True)}

    def run(self) -> TransferredLandmarks:
        """Predict every specimen, and every template from the others."""
        errors, evidence = self._leave_one_out()
        calibration = calibrate(errors, evidence)
        found = [self._specimen(name, calibration) for name in self._view.names]
        names = tuple(self._dense.names[item.shape] for item in self._templates)
        unit = np.array([self._scale[name] for name in names])[:, None]
        rest = [evidence[:at] + evidence[at + 1 :] for at in range(len(evidence))]
        without = [calibrate(np.delete(errors, at, 0), others) for at, others in enumerate(rest)]
        radius = np.array([radii(one, own) for one, own in zip(without, evidence, strict=True)])
        return TransferredLandmarks(
            names=self._view.names,
            labels=self._labels,
            points=read_only(np.stack([points for points, _, _ in found])),
            radii=read_only(np.stack([radius for _, radius, _ in found])),
            status=tuple(status for _, _, status in found),
            templates=names,
            left_out_errors=read_only(errors / unit),
            left_out_radii=read_only(radius / unit),
        )

    def _leave_one_out(self) -> tuple[FloatArray, list[Evidence]]:
        """Errors (t, l), in the common frame, of every template predicted from the others, and their evidence."""
        shape = (len(self._templates), len(self._labels))
        if len(self._templates) < 2:
            nothing = np.full(shape[1], np.nan)
            return np.full(shape, np.nan), [Evidence(spread=nothing, distance=0.0, residual=nothing, unit=1.0)]
        errors, evidence = [], []
        for at, item in enumerate(self._templates):
            name = self._dense.names[item.shape]
            points, shown = self._predict(name, self._templates[:at] + self._templates[at + 1 :])
            errors.append(np.linalg.norm(points - self._posed(name, self._known[name]), axis=1))
            evidence.append(shown)
        return np.array(errors), evidence

    def _specimen(self, name: str, calibration: Calibration) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
        """Points and radii in the file's unit and what became of each landmark."""
        own = self._known.get(name, np.full((len(self._labels), 3), np.nan))
        placed = np.isfinite(own).all(axis=1)
        points, radius = np.array(own), np.where(placed, 0.0, np.nan)
        reason = self._abstention(name)
        if reason is None and not placed.all():
            predicted, evidence = self._predict(name, self._templates)
            inverse = np.linalg.inv(self._view.transforms[self._view.index(name)])
            points[~placed] = (predicted @ inverse[:3, :3].T + inverse[:3, 3])[~placed]
            radius[~placed] = radii(calibration, evidence)[~placed] / self._scale[name]
        there = np.isfinite(points).all(axis=1)
        known = np.isfinite(np.stack([item.offsets for item in self._templates])).all(axis=2).any(axis=0)
        words = np.where(placed, PLACED, np.where(there, CARRIED, reason or np.where(known, MISSING_PLACE, UNKNOWN)))
        return points, radius, tuple(words.tolist())

    def _abstention(self, name: str) -> str | None:
        if name not in self._rows:
            return NOT_REGISTERED
        doubtful = self._view.confidence[self._view.index(name)] < DOUBT
        return DOUBTFUL_POSE if doubtful else None

    def _predict(self, name: str, templates: list[Template]) -> tuple[FloatArray, Evidence]:
        """Landmarks of a specimen, in the common frame, and what the prediction shows of its error."""
        row, at, dense = self._rows[name], self._view.index(name), self._dense
        points, spreads = fuse(templates, row, dense.vertices, dense.quality)
        shape = read_shape(self._view.file(at), name=name).transformed(self._view.transforms[at])
        evidence = Evidence(
            spread=spreads,
            distance=template_distance(templates, row, dense.vertices),
            residual=at_places(templates, dense.residual[row]).mean(axis=0),
            unit=self._radius,
        )
        return on_surface(points, templates, SurfaceLocator(shape.vertices, shape.faces)), evidence

    def _posed(self, name: str, points: FloatArray) -> FloatArray:
        T = self._view.transforms[self._view.index(name)]
        return np.asarray(points @ T[:3, :3].T + T[:3, 3])
