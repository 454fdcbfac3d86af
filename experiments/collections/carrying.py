"""Measures how well expert landmarks are carried over a collection in random poses, from its files on."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import collalign
from collalign.confidence.radius_model import MIN_TEMPLATES
from collalign.engine.records import Record
from collalign.engine.run_options import RunOptions
from collalign.engine.store_file import STORE_FILE
from collalign.products.trust import DOUBT
from collalign.template_landmarks.table import landmark_table
from collalign.tools.transfer.carrier import LandmarkCarrier
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.io.files import natural_key
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.landmark_files import Landmarks
from data_tools.rotations import random_rotation
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape
from experiments.clock import stopwatch
from experiments.collections.landmarked import read_dataset
from experiments.experiment import Cell

#: Whose errors are given in the files' unit; of other collections, which have no common one, in each target's root
#: mean square radius.
IN_FILE_UNITS = ("mouse skulls",)


@dataclass(frozen=True, kw_only=True, eq=False)
class LandmarkedFolder:
    """Shapes with landmarks, written in random poses.

    Attributes
    ----------
    folder : Path
    names : tuple of str
        In the order of a folder.
    landmarks : ndarray, shape (N, l, 3)
        In the coordinates of the files.
    units : ndarray, shape (N,)
        Length in each file that errors are counted in.
    """

    folder: Path
    names: tuple[str, ...]
    landmarks: FloatArray
    units: FloatArray

    def shape(self, which: int) -> Shape:
        """Read one shape."""
        return read_shape(self.folder / f"{self.names[which]}.ply", name=self.names[which])


def write_posed(cell: Cell, folder: Path) -> LandmarkedFolder:
    """Write the cell's choice of a collection in uniformly random poses; the same settings give the same files."""
    settings = cell.settings
    dataset = read_dataset(settings["dataset"], cell.data)
    if dataset.landmarks is None:
        raise InputError(f"{settings['dataset']}: has no landmarks")
    rng = np.random.default_rng(settings["seed"])
    chosen = np.sort(rng.permutation(len(dataset))[: settings["num"]]).tolist()
    marks, units = [], []
    for which in chosen:
        shape, rotation = dataset.shape(which), random_rotation(rng)
        posed = Shape.from_arrays(shape.vertices @ rotation.T, shape.faces, name=shape.name)
        write_mesh(folder / f"{shape.name}.ply", posed)
        marks.append(dataset.landmarks[which] @ rotation.T)
        centred = shape.vertices - shape.vertices.mean(axis=0)
        radius = float(np.sqrt((centred**2).sum(axis=1).mean()))
        units.append(1.0 if settings["dataset"] in IN_FILE_UNITS else radius)
    names = [dataset.names[which] for which in chosen]
    order = sorted(range(len(names)), key=lambda at: natural_key(f"{names[at]}.ply"))
    return LandmarkedFolder(
        folder=folder,
        names=tuple(names[at] for at in order),
        landmarks=np.array(marks)[order],
        units=np.array(units)[order],
    )


def measure_carrying(cell: Cell) -> Record:
    """Align a folder and carry landmarks from sets of templates to all other specimens, by ``collalign transfer``.

    Returns
    -------
    dict
        ``names``, ``transforms`` (N, 4, 4); ``register_s``, CPU time of one registration; per number of
        templates ``k``: ``carried k`` and ``closest k``, errors of each set's other specimens (s, l), and
        ``radii k`` beside them; ``pairs``, errors (p, l) of single pairs (target, source).
    """
    settings = cell.settings
    with tempfile.TemporaryDirectory() as scratch:
        (folder := Path(scratch) / "shapes").mkdir()
        posed, out = write_posed(cell, folder), Path(scratch) / "out"
        run = RunOptions(jobs=1, store=Path(scratch) / STORE_FILE)
        collalign.align_collection(folder, run=run, progress=False).save(out, report=False)
        with stopwatch() as elapsed:
            collalign.maps.dense_correspondence(out, run=run, progress=False)
        collection = collalign.load(out)
        found: dict[str, Any] = {
            "names": list(collection.names),
            "transforms": np.array(collection.transforms),
        }
        found["register_s"] = elapsed.processor_s / (2 * len(posed.names))
        rng = np.random.default_rng([settings["seed"], 1])
        for k, sets in settings["sets"]:
            chosen = [rng.permutation(len(posed.names))[:k].tolist() for _ in range(sets)]
            carried = [carried_errors(out, posed, one, run) for one in chosen]
            found[f"carried {k}"] = np.concatenate([errors for errors, _ in carried])
            found[f"radii {k}"] = np.concatenate([radii for _, radii in carried])
            closest = [_closest(posed, found["transforms"], one) for one in chosen]
            found[f"closest {k}"] = np.concatenate(closest)
        singles = {
            j: carried_errors(out, posed, [j], run)[0]
            for j in sorted({j for _, j in settings["pairs"]})
        }
        found["pairs"] = np.array(
            [singles[j][_others(posed, [j]).index(i)] for i, j in settings["pairs"]]
        )
        return found


def carried_errors(
    out: Path, posed: LandmarkedFolder, templates: Sequence[int], run: RunOptions
) -> tuple[FloatArray, FloatArray]:
    """Return errors and radii of all specimens that are no templates, in the collection's unit."""
    labels = tuple(str(number) for number in range(posed.landmarks.shape[1]))
    given = {
        posed.names[at]: Landmarks(labels=labels, points=posed.landmarks[at]) for at in templates
    }
    found = collalign.landmarks.transfer_landmarks(out, given, run=run, progress=False)
    if found.names != posed.names:
        raise InputError("a shape was left out: errors would be those of a choice")
    others = _others(posed, templates)
    errors = np.linalg.norm(found.points - posed.landmarks, axis=2) / posed.units[:, None]
    return errors[others], (found.radii / posed.units[:, None])[others]


def _closest(
    posed: LandmarkedFolder, transforms: FloatArray, templates: Sequence[int]
) -> FloatArray:
    """Return the errors of the points closest to the mean of the templates' landmarks at the poses."""
    mean = np.mean([moved(transforms[at], posed.landmarks[at]) for at in templates], axis=0)
    errors = []
    for at in _others(posed, templates):
        points = on_shape(posed.shape(at).transformed(transforms[at]), mean)
        truth = moved(transforms[at], posed.landmarks[at])
        errors.append(
            np.linalg.norm(points - truth, axis=1) / (posed.units[at] * scale_of(transforms[at]))
        )
    return np.array(errors)


def _others(posed: LandmarkedFolder, templates: Sequence[int]) -> list[int]:
    return [at for at in range(len(posed.names)) if at not in templates]


def on_shape(shape: Shape, points: FloatArray) -> FloatArray:
    """Return the closest points of a shape's surface."""
    return SurfaceLocator(shape.vertices, shape.faces).closest(points).on(shape.vertices)


def moved(transform: FloatArray, points: FloatArray) -> FloatArray:
    """Return points where a transform (4, 4) takes them."""
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def scale_of(transform: FloatArray) -> float:
    """Return the factor of a similarity (4, 4), mirrored or not."""
    return float(np.cbrt(abs(np.linalg.det(transform[:3, :3]))))


def measure_few(cell: Cell) -> Record:
    """Return what one, two and three templates show at each landmark that they carry, and its error.

    Settings: ``dataset``, ``num`` shapes, ``seed``, and ``sets`` of templates of each size.

    Returns
    -------
    dict
        By the number of templates ``k``: ``shown k`` (m, 4), :meth:`RadiusEvidence.shown`, ``shown held k`` (m, 3),
        :meth:`RadiusEvidence.shown_held`, ``errors k`` (m,) and ``held k`` (m,), :meth:`RadiusEvidence.held_errors`,
        in root mean square radii, ``root k`` (m,), the cube root of the determinant of the root of hold, and
        ``landmark k`` (m,), which one it is; ``variation`` of the shapes in radii. Shapes in doubt get no landmarks,
        as in a transfer.
        ``processor_s``.
    """
    settings = cell.settings
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as scratch, stopwatch() as elapsed:
        (folder := Path(scratch) / "shapes").mkdir()
        posed, out = write_posed(cell, folder), Path(scratch) / "out"
        run = RunOptions(jobs=1, store=Path(scratch) / STORE_FILE)
        collalign.align_collection(folder, run=run, progress=False).save(out, report=False)
        dense = collalign.maps.dense_correspondence(out, run=run, progress=False)
        collection = collalign.load(out)
        labels = tuple(str(number) for number in range(posed.landmarks.shape[1]))
        given = {
            name: Landmarks(labels=labels, points=points)
            for name, points in zip(posed.names, posed.landmarks, strict=True)
        }
        transforms = {name: collection[name].transform for name in given}
        carrier = LandmarkCarrier(collection, dense, landmark_table(given, transforms))
        templates = {
            dense.names[item.shape]: item
            for item in carrier.templates
            if collection[dense.names[item.shape]].confidence >= DOUBT
        }
        rng = np.random.default_rng([settings["seed"], 1])
        sets = [
            [list(templates)[at] for at in rng.permutation(len(templates))[:k]]
            for k in range(1, MIN_TEMPLATES)
            for _ in range(settings["sets"])
        ]
        rows: dict[int, list[FloatArray]] = {
            k: [np.empty((0, 11))] for k in range(1, MIN_TEMPLATES)
        }
        for name in templates:
            specimen = carrier.look_at(name)
            for chosen in (chosen for chosen in sets if name not in chosen):
                points, evidence, lost = carrier.predict(
                    specimen, [templates[one] for one in chosen]
                )
                away = carrier.errors(name, points)
                found["variation"] = evidence.variation / evidence.unit
                every = np.column_stack(
                    [
                        np.arange(len(away)),
                        np.linalg.norm(away, axis=1) / evidence.unit,
                        evidence.held_errors(away) / evidence.unit,
                        np.cbrt(np.linalg.det(evidence.held)),
                        evidence.shown(),
                        evidence.shown_held(),
                    ]
                )
                rows[len(chosen)].append(every[lost == ""])
        for k, of in rows.items():
            every = np.concatenate(of)
            for name, column in zip(("landmark", "errors", "held", "root"), every.T, strict=False):
                found[f"{name} {k}"] = column
            found[f"shown {k}"], found[f"shown held {k}"] = every[:, 4:8], every[:, 8:]
    return {**found, "processor_s": elapsed.processor_s}
