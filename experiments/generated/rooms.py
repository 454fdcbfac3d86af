"""Generated rooms and corridors with furniture, and what a depth camera sees of them on its way round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.shape import Shape
from experiments.generated.assembled import CLASSES, Part, box, cylinder


class Camera(NamedTuple):
    """A depth camera: its pixels, half its horizontal angle of view, and how it fails. Lengths are metres."""

    width: int = 128
    height: int = 96
    half_angle: float = 0.5
    reach: float = 4.5
    """What is farther off is not seen."""
    noise: float = 0.0015
    """Deviation of the depth at one metre; it grows with the square of the depth (Khoshelham and Elberink 2012)."""
    lost: float = 0.02
    """Share of pixels without a depth."""
    jump: float = 0.08
    """Pixels whose depths differ by this share are not connected."""


CAMERA = Camera()
#: Points over a room for each pixel that one covers at two metres, and a camera's height.
_DENSITY, _EYE = 5.0, 1.4
#: Furniture of a room, with the size in metres of an object of that class.
_FURNITURE = {
    "chairs": 0.45,
    "desks": 0.9,
    "sofas": 0.8,
    "lamps": 0.6,
    "computers": 0.4,
    "beds": 0.8,
}


def room(rng: np.random.Generator, *, corridor: bool = False) -> list[Part]:
    """Return a room, or a long corridor, with a column, shelves on its walls and furniture along them."""
    length, width = (9.0, 2.6) if corridor else rng.uniform([4.4, 3.6], [5.6, 4.6])
    height = 2.6
    parts = [
        box((length, width, 0.1), (0, 0, -0.05)),
        box((length, width, 0.1), (0, 0, height + 0.05)),
        box((length, 0.1, height), (0, -width / 2, height / 2)),
        box((length, 0.1, height), (0, width / 2, height / 2)),
        box((0.1, width, height), (-length / 2, 0, height / 2)),
        box((0.1, width, height), (length / 2, 0, height / 2)),
        cylinder(0.15, height, (0.4 * length, 0.4 * width, height / 2)),
    ]
    for at in range(12):
        size = rng.uniform([0.3, 0.12, 0.1], [0.9, 0.35, 0.5]).tolist()
        on_wall = _along_walls(length, width, size[1] / 2, at / 12 + rng.uniform(0.0, 0.08))
        parts.append(_turned(box(size, (0, 0, rng.uniform(0.6, 2.2))), *on_wall))
    names, num = list(_FURNITURE), 16 if corridor else 10
    for at in range(num):
        name = names[int(rng.integers(len(names)))]
        place, turn = _along_walls(
            length, width, 0.6 * _FURNITURE[name], at / num + rng.uniform(0.0, 0.5 / num)
        )
        parts += [
            _turned(part, place, turn + rng.uniform(-1.0, 1.0))
            for part in _on_floor(CLASSES[name](rng), _FURNITURE[name])
        ]
    return parts


def _along_walls(
    length: float, width: float, inside: float, share: float
) -> tuple[FloatArray, float]:
    """Return a place on the way along the walls, ``inside`` of them, and the turn of the wall there."""
    at = (share % 1.0) * 2.0 * (length + width)
    for wall, (along, across) in enumerate(((length, width), (width, length)) * 2):
        if at <= along:
            turn = 0.5 * np.pi * wall
            local = np.array([at - along / 2, inside - across / 2, 0.0])
            return Rotation.from_rotvec([0.0, 0.0, turn]).apply(local), turn
        at -= along
    raise AssertionError("a share is below one")


def _on_floor(parts: list[Part], size: float) -> list[Part]:
    """Return an object of this size with its lowest point on the floor."""
    points = np.concatenate([vertices for vertices, _ in parts])
    scale = size / float(np.ptp(points, axis=0).max())
    lift = np.array([0.0, 0.0, -points[:, 2].min()])
    return [((vertices + lift) * scale, faces) for vertices, faces in parts]


def _turned(part: Part, place: FloatArray, turn: float) -> Part:
    vertices, faces = part
    return Rotation.from_rotvec([0.0, 0.0, turn]).apply(vertices) + place, faces


def way_round(num: int, rng: np.random.Generator, *, corridor: bool = False) -> FloatArray:
    """Return poses (num, 4, 4) of a camera, camera to room: a turn in a room, or along a corridor and back.

    The camera looks along its z axis, x points right and y down.
    """
    share = np.arange(num) / num
    if corridor:
        along = 3.2 * np.cos(2 * np.pi * share)
        turned = np.where(share < 0.5, np.pi, 0.0) + 0.5 * np.sin(6 * np.pi * share)
        places = np.column_stack([along, 0.3 * np.sin(2 * np.pi * share), np.full(num, _EYE)])
    else:
        turned = 2 * np.pi * share
        places = np.column_stack([-0.5 * np.cos(turned), -0.5 * np.sin(turned), np.full(num, _EYE)])
    places = places + rng.normal(0.0, 0.04, places.shape)
    pitch = 0.25 + rng.normal(0.0, 0.05, num)
    ahead = np.column_stack(
        [np.cos(turned) * np.cos(pitch), np.sin(turned) * np.cos(pitch), -np.sin(pitch)]
    )
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (num, 1, 1))
    poses[:, :3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=2)
    poses[:, :3, 3] = places
    return poses


def depth_frames(
    parts: Sequence[Part],
    poses: FloatArray,
    rng: np.random.Generator,
    camera: Camera = CAMERA,
) -> tuple[Shape, ...]:
    """Return what a camera sees at each pose, as meshes in its own coordinates, all triangles towards it."""
    cloud = _spread(parts, camera, rng)
    width = len(str(len(poses) - 1))
    return tuple(
        _frame(moved(np.linalg.inv(pose), cloud), camera, rng, f"frame{k:0{width}d}")
        for k, pose in enumerate(poses)
    )


def moved(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Return points (n, 3) at a rigid pose (4, 4)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _spread(parts: Sequence[Part], camera: Camera, rng: np.random.Generator) -> FloatArray:
    """Return random points on all triangles, evenly by area."""
    corners = np.concatenate([vertices[faces] for vertices, faces in parts])
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * np.linalg.norm(np.cross(one, other), axis=1)
    pixel = 2.0 * 2.0 * np.tan(camera.half_angle) / camera.width
    which = rng.choice(len(areas), int(_DENSITY * areas.sum() / pixel**2), p=areas / areas.sum())
    u, v = np.sort(rng.random((2, len(which))), axis=0)
    return np.asarray(corners[which, 0] + u[:, None] * one[which] + (v - u)[:, None] * other[which])


def _frame(points: FloatArray, camera: Camera, rng: np.random.Generator, name: str) -> Shape:
    """Return the mesh of the nearest points (n, 3), in camera coordinates, by pixel."""
    focal = 0.5 * camera.width / np.tan(camera.half_angle)
    points = points[(points[:, 2] > 0.3) & (points[:, 2] < camera.reach)]
    column = np.floor(focal * points[:, 0] / points[:, 2] + camera.width / 2).astype(np.int64)
    row = np.floor(focal * points[:, 1] / points[:, 2] + camera.height / 2).astype(np.int64)
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    depths = np.full((camera.height, camera.width), np.inf)
    np.minimum.at(depths, (row[inside], column[inside]), points[inside, 2])
    noise, is_lost = rng.standard_normal(depths.shape), rng.random(depths.shape) < camera.lost
    is_lost |= np.isinf(depths)
    depths = np.where(is_lost, 0.0, depths)
    depths += camera.noise * depths**2 * noise
    rows, columns = np.indices(depths.shape)
    vertices = np.stack(
        [
            (columns + 0.5 - camera.width / 2) * depths / focal,
            (rows + 0.5 - camera.height / 2) * depths / focal,
            depths,
        ],
        axis=-1,
    )
    faces = _triangles(depths, camera.jump)
    used = np.unique(faces)
    return Shape.from_arrays(vertices.reshape(-1, 3)[used], np.searchsorted(used, faces), name=name)


def _triangles(depths: FloatArray, jump: float) -> IntArray:
    """Return the two triangles of every four neighbouring pixels of like depths; 0 is none."""
    number = np.arange(depths.size).reshape(depths.shape)
    corners = np.stack(
        [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1
    )
    faces = np.concatenate([corners[..., [0, 2, 1]], corners[..., [0, 3, 2]]]).reshape(-1, 3)
    of_faces = depths.ravel()[faces]
    near, far = of_faces.min(axis=1), of_faces.max(axis=1)
    return np.asarray(faces[(near > 0.0) & (far - near < jump * near)])
