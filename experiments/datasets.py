"""Readers of the layouts in which public collections come: shapes on demand, and their ground truth.

Each reader takes the collection's folder and returns a :class:`Dataset`. Nothing is downloaded, and no shape is read
before it is asked for.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.arrays import FloatArray, IntArray, as_points, as_rotations, read_only
from data_tools.errors import InputError
from data_tools.io.files import existing_file, natural_key
from data_tools.io.listing import read_folder
from data_tools.io.shapes import read_shape
from data_tools.landmark_files import read_landmarks
from data_tools.options import AS_STORED
from data_tools.surface.outliers import without_outliers
from data_tools.surface.shape import Shape
from experiments.ground_truth import landmark_rotation, read_symmetry, read_vertex_indices


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """A collection with what is known about it. Arrays are read-only; what is unknown is None or empty.

    Attributes
    ----------
    names : tuple of str
        Of its N shapes.
    loaders : tuple of callable
        Each reads one shape; see :meth:`shape`.
    landmarks : ndarray, shape (N, l, 3), or None
        Corresponding points in the coordinates of each shape, NaN where missing.
    landmark_vertices : ndarray of int, shape (N, l), or None
        The vertex at (or nearest to) each landmark.
    mirror : ndarray of int, shape (l,), or None
        The landmark that each becomes in a mirror image of the shape.
    labels : dict of str to tuple of str
        Classes of the shapes, "" where unknown.
    chirality : ndarray of int, shape (N,), or None
        +1 and -1 for left and right specimens.
    rotations, translations : ndarray, shapes (N, 3, 3) and (N, 3), or None
        Known poses: x_common = rotations[i] @ x_shape + translations[i].
    vertices_correspond : bool
        Whether vertex j is the same point on all shapes.
    """

    names: tuple[str, ...]
    loaders: tuple[Callable[[], Shape], ...]
    landmarks: FloatArray | None = None
    landmark_vertices: IntArray | None = None
    mirror: IntArray | None = None
    labels: dict[str, tuple[str, ...]] = field(default_factory=dict)
    chirality: IntArray | None = None
    rotations: FloatArray | None = None
    translations: FloatArray | None = None
    vertices_correspond: bool = False

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Return the position of a shape.

        Raises
        ------
        InputError
            If there is none of this name.
        """
        if name not in self.names:
            raise InputError(f"no shape is called {name!r}")
        return self.names.index(name)

    def shape(self, which: int | str) -> Shape:
        """Read one shape, by position or name."""
        return self.loaders[self.index(which) if isinstance(which, str) else which]()

    def rotation(self, target: int, source: int, *, group: str = "SO") -> FloatArray:
        """Return the true R_target_source, shape (3, 3): from known poses, corresponding vertices, or landmarks.

        Vertices far from all others are marks for "unknown", as four of the landmark sets have, and no places.

        Raises
        ------
        InputError
            If none of these is known.
        """
        if self.rotations is not None:
            return self.rotations[target].T @ self.rotations[source]
        if self.vertices_correspond:
            to, of = self.shape(target), self.shape(source)
            known = np.intersect1d(
                without_outliers(to).file_indices, without_outliers(of).file_indices
            )
            return landmark_rotation(to.vertices[known], of.vertices[known], group=group)
        if self.landmarks is None:
            raise InputError("the collection has neither poses nor landmarks")
        return landmark_rotation(self.landmarks[target], self.landmarks[source], group=group)


def read_teeth(folder: Path | str, *, num_landmarks: int = 16) -> Dataset:
    """Read the 116 molars of Boyer et al. 2011: ``labels.csv``, ``landmarks_mesh_coords.npz``, ``meshes/``.

    Parameters
    ----------
    folder : Path or str
    num_landmarks : int
        The literature compares the first 16 of the 18.
    """
    folder = Path(folder)
    rows = _table(
        folder / "labels.csv",
        ("name", "file", "order", "family", "genus", "chirality_from_landmarks"),
    )
    names = tuple(row["name"] for row in rows)
    arrays = _arrays(folder / "landmarks_mesh_coords.npz", ("names", "landmarks", "nearest_vertex"))
    order = _order(folder, names, [str(n) for n in arrays["names"]])
    classes = ("order", "family", "genus")
    return Dataset(
        names=names,
        loaders=tuple(
            partial(read_shape, folder / "meshes" / Path(r["file"]).name, name=r["name"])
            for r in rows
        ),
        landmarks=read_only(
            np.ascontiguousarray(arrays["landmarks"][order, :num_landmarks], dtype=np.float64)
        ),
        landmark_vertices=read_only(
            np.ascontiguousarray(arrays["nearest_vertex"][order, :num_landmarks])
        ),
        labels={key: tuple("" if r[key] == "NA" else r[key] for r in rows) for key in classes},
        chirality=read_only(np.array([int(r["chirality_from_landmarks"]) for r in rows])),
    )


def read_shrec07_class(folder: Path | str) -> Dataset:
    """Read one class of SHREC07 with the points of Kim et al. 2011: ``meshes/``, ``landmarks/``, ``*.sym.info``."""
    folder = Path(folder)
    listing = read_folder(folder / "meshes")
    landmarks = [
        np.loadtxt(folder / "landmarks" / f"{name}.vts", ndmin=2) for name in listing.names
    ]
    if len({mark.shape for mark in landmarks}) != 1:
        raise InputError(f"{folder}: its landmark files have different numbers of points")
    symmetries = sorted(folder.glob("*.sym.info"))
    return Dataset(
        names=listing.names,
        loaders=tuple(partial(read_shape, file) for file in listing.files),
        landmarks=read_only(np.stack(landmarks)[:, :, 1:]),  # behind the vertex of each
        landmark_vertices=read_only(np.stack(landmarks)[:, :, 0].astype(np.int64)),
        mirror=read_only(read_symmetry(symmetries[0], num_landmarks=len(landmarks[0])))
        if symmetries
        else None,
        labels={"class": (folder.name,) * len(listing.names)},
    )


def read_registered_archive(folder: Path | str) -> Dataset:
    """Read registered meshes kept in one ``*.npz`` (SCAPE): ``vertices`` (N, v, 3), ``faces`` (N, f, 3), ``names``.

    Beside it may lie ``*.sym.labels``, and ``Corrs/*.pid`` with ``Corrs/*.sym.info``.
    """
    folder = Path(folder)
    archives = sorted(folder.glob("*.npz"))
    if len(archives) != 1:
        raise InputError(f"{folder}: expected one .npz archive, found {len(archives)}")
    arrays = _arrays(archives[0], ("vertices", "faces", "names"))
    vertices, faces, names = (
        arrays["vertices"],
        arrays["faces"],
        tuple(str(n) for n in arrays["names"]),
    )
    if vertices.ndim != 3 or faces.ndim != 3 or not len(vertices) == len(faces) == len(names):
        raise InputError(
            f"{archives[0]}: arrays of shapes {vertices.shape}, {faces.shape} for {len(names)} names"
        )
    loaders = tuple(
        partial(Shape.from_arrays, v, f, name=n, file=archives[0])
        for v, f, n in zip(vertices, faces, names, strict=True)
    )
    return _registered(names, loaders, vertices.shape[1], folder / "Corrs")


def read_registered_folder(folder: Path | str) -> Dataset:
    """Read registered meshes kept as files in ``meshes/`` (one TOSCA class), with ``*.pid``."""
    folder = Path(folder)
    listing = read_folder(folder / "meshes")
    loaders = tuple(partial(read_shape, file, AS_STORED) for file in listing.files)
    return _registered(listing.names, loaders, len(loaders[0]().vertices), folder)


def read_range_scans(folder: Path | str) -> Dataset:
    """Read scans with their poses in a ``*.conf`` file (Stanford 3D Scanning Repository).

    A line ``bmesh FILE tx ty tz qx qy qz qw`` places a scan: x_common = R(q)^T x_scan + t.
    """
    folder = Path(folder)
    files = sorted(folder.glob("*.conf"))
    if len(files) != 1:
        raise InputError(f"{folder}: expected one .conf file, found {len(files)}")
    rows = [
        line.split() for line in existing_file(files[0]).read_text(errors="replace").splitlines()
    ]
    rows = [row for row in rows if row[:1] == ["bmesh"]]
    try:
        poses = np.array([[float(word) for word in row[2:9]] for row in rows]).reshape(len(rows), 7)
    except ValueError as error:
        raise InputError(f"{files[0]}: malformed pose ({error})") from error
    scans = [folder / Path(row[1]).name for row in rows]
    rotations = (
        np.stack([_quaternion_matrix(q).T for q in poses[:, 3:]]) if rows else np.empty((0, 3, 3))
    )
    return Dataset(
        names=tuple(scan.stem for scan in scans),
        loaders=tuple(partial(read_shape, scan, AS_STORED) for scan in scans),
        rotations=read_only(as_rotations(rotations, f"{files[0]}: rotations", group="SO")),
        translations=read_only(np.ascontiguousarray(poses[:, :3])),
    )


def read_landmarked_folder(folder: Path | str) -> Dataset:
    """Read meshes in ``meshes/`` with landmarks in ``landmarks/NAME.csv`` (the skulls of 62 strains of mice)."""
    folder = Path(folder)
    listing = read_folder(folder / "meshes")
    landmarks = [
        read_landmarks(folder / "landmarks" / f"{name}.csv").points for name in listing.names
    ]
    if len({len(points) for points in landmarks}) != 1:
        raise InputError(f"{folder}: its landmark files have different numbers of points")
    return Dataset(
        names=listing.names,
        loaders=tuple(partial(read_shape, file) for file in listing.files),
        landmarks=read_only(np.stack(landmarks)),
    )


def read_canonical_class(folder: Path | str) -> Dataset:
    """Read meshes in ``meshes/`` whose canonical poses ``truth.json`` holds (one class of CAPOD, Papadakis 2014)."""
    folder = Path(folder)
    listing = read_folder(folder / "meshes")
    try:
        rows = json.loads(existing_file(folder / "truth.json").read_text())["shapes"]
        to_file = {
            row["name"]: np.asarray(row["pose_common_to_file"], dtype=np.float64)[:3, :3]
            for row in rows
        }
        rotations = np.stack([to_file[name].T for name in listing.names])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{folder / 'truth.json'}: not the poses of the meshes ({error})"
        ) from error
    return Dataset(
        names=listing.names,
        loaders=tuple(partial(read_shape, file, AS_STORED) for file in listing.files),
        rotations=read_only(as_rotations(rotations, f"{folder}: poses", group="SO")),
    )


def read_truth_folder(folder: Path | str) -> Dataset:
    """Read the shapes that ``truth.json`` lists, each with its file, pose, chirality and landmarks.

    A pose (4, 4) takes the common frame to the file. Where ``truth`` is "landmarks", these tell the rotations.
    """
    folder = Path(folder)
    file = existing_file(folder / "truth.json")
    try:
        truth = json.loads(file.read_text())
        rows = truth["shapes"]
        names = tuple(str(row["name"]) for row in rows)
        files = [folder / row["file"] for row in rows]
        by_landmarks = truth["truth"] == "landmarks"
        values = [
            np.asarray(row["landmarks"] if by_landmarks else row["pose"], dtype=np.float64)
            for row in rows
        ]
        rotations = None if by_landmarks else np.stack([pose[:3, :3].T for pose in values])
        marks = np.stack(values) if by_landmarks else None
        sides = np.array([int(row["chirality"]) for row in rows])
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"{file}: not the truth of a collection ({error!r})") from error
    return Dataset(
        names=names,
        loaders=tuple(
            partial(read_shape, path, AS_STORED, name=name)
            for path, name in zip(files, names, strict=True)
        ),
        landmarks=None if marks is None else read_only(marks),
        rotations=None
        if rotations is None
        else read_only(as_rotations(rotations, f"{file}: poses", group="O")),
        chirality=read_only(sides) if len(set(sides.tolist())) > 1 else None,
    )


def read_landmark_archive(path: Path | str) -> Dataset:
    """Read landmarks alone from an ``.npz`` of ``landmarks`` (N, l, 3) and ``names``: the shapes are point clouds."""
    path = Path(path)
    arrays = _arrays(path, ("landmarks", "names"))
    names = tuple(str(n) for n in arrays["names"])
    points = [
        as_points(p, f"{path}: {name}", dim=3)
        for name, p in zip(names, arrays["landmarks"], strict=True)
    ]
    num = {len(p) for p in points}
    if len(num) != 1:
        raise InputError(f"{path}: holds no landmarks")
    order = np.tile(np.arange(num.pop()), (len(points), 1))
    return Dataset(
        names=names,
        loaders=tuple(
            partial(Shape.from_arrays, p, name=n, file=path)
            for n, p in zip(names, points, strict=True)
        ),
        landmarks=read_only(np.stack(points)),
        landmark_vertices=read_only(order),
        vertices_correspond=True,
    )


def _registered(
    names: tuple[str, ...], loaders: tuple[Callable[[], Shape], ...], num_vertices: int, marks: Path
) -> Dataset:
    points = sorted(marks.glob("*.pid"))
    indices = read_vertex_indices(points[0], num_vertices=num_vertices) if points else None
    return Dataset(
        names=names,
        loaders=loaders,
        landmark_vertices=None if indices is None else read_only(np.tile(indices, (len(names), 1))),
        mirror=None if indices is None else _mirror(sorted(marks.glob("*.sym.info")), len(indices)),
        vertices_correspond=True,
    )


def _mirror(files: list[Path], num_landmarks: int) -> IntArray | None:
    return read_only(read_symmetry(files[0], num_landmarks=num_landmarks)) if files else None


def _table(path: Path, columns: tuple[str, ...]) -> list[dict[str, str]]:
    with existing_file(path).open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        rows = list(csv.DictReader(stream))
    missing = [c for c in columns if not rows or rows[0].get(c) is None]
    if missing or any(None in row.values() for row in rows):
        raise InputError(
            f"{path}: {'no columns ' + ', '.join(missing) if missing else 'a row is too short'}"
        )
    return rows


def _arrays(path: Path, keys: tuple[str, ...]) -> dict[str, Any]:
    try:
        with np.load(existing_file(path), allow_pickle=False) as archive:
            return {key: archive[key] for key in keys}
    except (ValueError, KeyError, OSError, EOFError) as error:
        raise InputError(
            f"{path}: not an archive of the arrays {', '.join(keys)} ({error})"
        ) from error


def _order(folder: Path, names: tuple[str, ...], stored: list[str]) -> IntArray:
    missing = sorted(set(names) - set(stored), key=natural_key)
    if missing:
        raise InputError(f"{folder}: no landmarks for {', '.join(missing[:5])}")
    return np.array([stored.index(name) for name in names], dtype=np.int64)


def _quaternion_matrix(quaternion: FloatArray) -> FloatArray:
    """Return R(q) of q = (x, y, z, w)."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
