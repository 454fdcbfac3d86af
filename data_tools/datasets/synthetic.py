"""Planted problems: pairs of point sets, deformed copies, whole collections, each with its exact answer."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray, IntArray, read_only, rms_length
from data_tools.datasets.synthetic_shapes import chair, smooth_field
from data_tools.embedding.surface_points import centre_and_radius, spread_over_triangles
from data_tools.errors import InputError, OptionsError
from data_tools.io.files import write_atomic
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread

#: Bumps of a deformed copy.
NUM_BUMPS = 12
#: Displacement of the demonstration's chairs, see :func:`bumped`.
DEMO_RMS = 0.015


def bumped(shape: Shape, rng: np.random.Generator, *, rms: float = 0.05) -> Shape:
    """Return a copy deformed by random smooth radial bumps, with the same vertices in the same order.

    Parameters
    ----------
    shape : Shape
    rng : numpy.random.Generator
    rms : float
        Root mean square displacement, as a fraction of the bounding box's diagonal: .045 to .08 is strong.
    """
    centre = shape.vertices.mean(axis=0)
    arms = shape.vertices - centre
    diagonal = float(np.linalg.norm(np.ptp(shape.vertices, axis=0)))
    field = smooth_field(shape.vertices, rng, num_bumps=NUM_BUMPS, width=0.15 * diagonal)[:, None]
    shift = field * arms / np.linalg.norm(arms, axis=1, keepdims=True)
    size = rms_length(shift)
    return _with_vertices(shape, shape.vertices + shift * (rms * diagonal / size))


def bent(shape: Shape, rng: np.random.Generator, *, angle: float = 0.8) -> Shape:
    """Return a copy whose outer parts are bent about random axes through the centre: nearly isometric limbs.

    Beyond a third of the radius of the shape, points rotate with their distance from the centre, by up to ``angle``
    radians; four random cones rotate each about an own axis.

    Parameters
    ----------
    shape : Shape
    rng : numpy.random.Generator
    angle : float
        Largest rotation, in radians.
    """
    arms = shape.vertices - shape.vertices.mean(axis=0)
    distance = np.linalg.norm(arms, axis=1)
    reach = np.clip(distance / distance.max() - 1.0 / 3.0, 0.0, None) * 1.5
    rotated = arms.copy()
    for axis in random_rotation(rng):
        cone = np.exp(-2.0 * (1.0 - arms @ axis / np.maximum(distance, 1e-300)))
        hinge = np.cross(axis, rng.standard_normal(3))
        rotated = _rotated(rotated, hinge / np.linalg.norm(hinge), angle * reach * cone)
    return _with_vertices(shape, rotated + shape.vertices.mean(axis=0))


def mirrored(shape: Shape) -> Shape:
    """Return the mirror image in the plane x = 0, its triangles still counterclockwise from outside."""
    return Shape.from_arrays(
        shape.vertices * [-1.0, 1.0, 1.0], shape.faces[:, ::-1], name=shape.name
    )


def shuffled(shape: Shape, rng: np.random.Generator) -> tuple[Shape, IntArray]:
    """Return a copy with vertices and triangles in random order, and the old index of each new vertex, (v,)."""
    order = rng.permutation(len(shape.vertices))
    rank = np.argsort(order)
    faces = rank[shape.faces]
    if shape.is_mesh:
        faces = faces[rng.permutation(len(faces))]
    return Shape.from_arrays(shape.vertices[order], faces, name=shape.name), order


def point_cloud(shape: Shape, rng: np.random.Generator, *, noise: float = 0.0) -> Shape:
    """Return the vertices alone, with noise whose deviation is a fraction of the bounding box's diagonal."""
    diagonal = float(np.linalg.norm(np.ptp(shape.vertices, axis=0)))
    disturbed = shape.vertices + noise * diagonal * rng.standard_normal(shape.vertices.shape)
    return Shape.from_arrays(disturbed, name=shape.name)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantedCollection:
    """Shapes in random poses, and where each comes from.

    Attributes
    ----------
    shapes : tuple of Shape
        The vertices of shape i are ``scales[i] * (unposed @ rotations[i]) + translations[i]``.
    rotations : ndarray, shape (N, 3, 3)
        R_common_shape: from each shape to the common frame; determinant -1 for mirrored shapes.
    scales : ndarray, shape (N,)
    translations : ndarray, shape (N, 3)
    origins : tuple of ndarray of int, each (v_i,)
        For each vertex, the corresponding vertex of the unposed member.
    """

    shapes: tuple[Shape, ...]
    rotations: FloatArray
    scales: FloatArray
    translations: FloatArray
    origins: tuple[IntArray, ...]

    @property
    def reflected(self) -> tuple[bool, ...]:
        """Which shapes were mirrored."""
        return tuple(bool(d < 0) for d in np.linalg.det(self.rotations))

    def relative_rotation(self, target: int, source: int) -> FloatArray:
        """Return R_target_source, shape (3, 3)."""
        return self.rotations[target].T @ self.rotations[source]


@one_blas_thread()
def planted_collection(
    members: Sequence[Shape],
    rng: np.random.Generator,
    *,
    group: str = "SO",
    scale_range: tuple[float, float] = (1.0, 1.0),
) -> PlantedCollection:
    """Put aligned shapes in random poses, with their vertices shuffled.

    Parameters
    ----------
    members : sequence of Shape
        In one frame, with distinct names.
    rng : numpy.random.Generator
    group : {"SO", "O"}
        With "O", each shape is mirrored with probability one half.
    scale_range : pair of float
        Scales are drawn from it, uniformly in the logarithm.

    Raises
    ------
    InputError
        If names repeat.
    """
    names = [member.name for member in members]
    if len(set(names)) < len(names):
        raise InputError("members: names repeat")
    shapes, origins = [], []
    rotations = np.stack([random_rotation(rng, group=group) for _ in members])
    scales = np.exp(rng.uniform(np.log(scale_range[0]), np.log(scale_range[1]), len(members)))
    translations = rng.standard_normal((len(members), 3))
    for member, rotation, scale, translation in zip(
        members, rotations, scales, translations, strict=True
    ):
        mixed, origin = shuffled(member, rng)
        faces = mixed.faces if np.linalg.det(rotation) > 0 else mixed.faces[:, ::-1]
        vertices = scale * (mixed.vertices @ rotation) + translation
        shapes.append(Shape.from_arrays(vertices, faces, name=member.name))
        origins.append(origin)
    return PlantedCollection(
        shapes=tuple(shapes),
        rotations=read_only(rotations),
        scales=read_only(scales),
        translations=read_only(translations),
        origins=tuple(origins),
    )


@one_blas_thread()
def deformed_family(
    base: Shape, num: int, rng: np.random.Generator, *, rms: float = 0.05
) -> tuple[Shape, ...]:
    """Return ``num`` bumped copies of one shape in one frame, named after it with a number."""
    width = len(str(num))
    copies = (bumped(base, rng, rms=rms) for _ in range(num))
    return tuple(
        Shape(name=f"{base.name}{i:0{width}d}", vertices=c.vertices, faces=c.faces)
        for i, c in enumerate(copies, 1)
    )


@one_blas_thread()
def demo_collection(*, seed: int = 0, num: int = 10, resolution: int = 2) -> PlantedCollection:
    """Return the collection that the demonstration aligns: chairs of varied proportions, bumped, in random poses.

    Parameters
    ----------
    seed : int
    num : int
        How many chairs.
    resolution : int
        Of their meshes: about 1400 vertices at 2.
    """
    rng = np.random.default_rng(seed)
    width = len(str(num))
    members = [
        bumped(chair(rng, resolution=resolution, name=f"chair{i:0{width}d}"), rng, rms=DEMO_RMS)
        for i in range(1, num + 1)
    ]
    return planted_collection(members, rng, scale_range=(0.7, 1.5))


def write_collection(folder: Path | str, collection: PlantedCollection) -> tuple[Path, ...]:
    """Write each shape to ``folder`` and the truth to ``folder/truth.json``.

    ``truth.json`` is ``{"shapes": [{"name", "file", "rotation": 3x3 from the shape to the common frame, "scale",
    "translation", "reflected"}]}``.

    Returns
    -------
    tuple of Path
        The mesh files, in the order of the collection.
    """
    folder = Path(folder)
    files = tuple(write_mesh(folder / f"{shape.name}.ply", shape) for shape in collection.shapes)
    records = [
        {
            "name": shape.name,
            "file": file.name,
            "rotation": collection.rotations[i].tolist(),
            "scale": float(collection.scales[i]),
            "translation": collection.translations[i].tolist(),
            "reflected": collection.reflected[i],
        }
        for i, (shape, file) in enumerate(zip(collection.shapes, files, strict=True))
    ]
    write_atomic(folder / "truth.json", (json.dumps({"shapes": records}, indent=1) + "\n").encode())
    return files


def _with_vertices(shape: Shape, vertices: FloatArray) -> Shape:
    return Shape.from_arrays(vertices, shape.faces, name=shape.name)


def _rotated(points: FloatArray, axis: FloatArray, angles: FloatArray) -> FloatArray:
    """Rotate each point about one axis by its own angle (Rodrigues)."""
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along = (points @ axis)[:, None] * axis
    return along + cos * (points - along) + sin * np.cross(axis, points)


#: Points that are spread over the mesh for each pixel that it covers, so that hardly a pixel stays empty.
_POINTS_A_PIXEL = 6.0
#: Least cosine between normal and line of sight of what a scanner still sees.
_STEEPEST_COSINE = 0.15


def range_view(
    shape: Shape,
    direction: FloatArray,
    *,
    pixels: int = 90,
    noise: float = 0.0,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the points of a mesh that a depth camera far away sees, in the coordinates of the mesh, shape (n, 3).

    Parameters
    ----------
    shape : Shape
        A mesh; a camera sees either side of an open sheet.
    direction : ndarray, shape (3,)
        From the mesh to the camera.
    pixels : int
        Pixels across four root mean square radii.
    noise : float
        Standard deviation of the depth, in root mean square radii.
    rng : numpy.random.Generator
        Of the noise.

    Raises
    ------
    OptionsError
        If the shape has no triangles.
    """
    if not shape.is_mesh:
        raise OptionsError("range views need a mesh")
    centre, radius = centre_and_radius(shape)
    size = 4.0 * radius / pixels
    points, normals = spread_over_triangles(shape, size / np.sqrt(_POINTS_A_PIXEL))
    sight = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    across = np.linalg.svd(sight[None])[2][1:].T
    depth = (points - centre) @ sight
    at = np.floor((points - centre) @ across / size).astype(np.int64)
    at -= at.min(axis=0)
    cells = at[:, 0] * (at[:, 1].max() + 1) + at[:, 1]
    order = np.lexsort((-depth, cells))
    nearest = order[np.unique(cells[order], return_index=True)[1]]
    seen = nearest[np.abs(normals[nearest] @ sight) > _STEEPEST_COSINE]
    return np.asarray(
        read_only(points[seen] + noise * radius * rng.standard_normal(len(seen))[:, None] * sight)
    )
