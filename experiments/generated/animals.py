"""Generated animals of four legs and a tail that bend sideways: both sides are alike, so none is a mirror image."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from data_tools.arrays import FloatArray
from data_tools.surface.shape import Shape

#: Grid points along the body, and how far limbs melt into it.
_RESOLUTION, _BLEND = 64, 0.06


def animal(rng: np.random.Generator) -> Shape:
    """Return an animal of random proportions in a random posture.

    Its back is z and its head x. The spine is an arc, the tail another, and every leg swings by itself, so that no
    posture has the mirror plane that the animal has at rest.
    """
    length, girth, tail, leg = rng.uniform([1.6, 0.16, 0.8, 0.45], [2.2, 0.26, 1.4, 0.65])
    turn, tail_turn = rng.uniform(-0.6, 0.6), rng.uniform(-1.2, 1.2)
    spine = _arc(length, turn, 7)
    capsules = [
        (a, b, girth * w)
        for a, b, w in zip(spine[:-1], spine[1:], (0.8, 1, 1, 1, 0.9, 0.7), strict=True)
    ]
    heading = spine[0] - spine[1]
    capsules.append((spine[0], spine[0] + 0.9 * heading + [0, 0, 0.08], 0.75 * girth))
    backwards = spine[-1] - spine[-2]
    angle = np.arctan2(backwards[1], backwards[0])
    turned = Rotation.from_rotvec([0.0, 0.0, angle + np.pi])
    ends = turned.apply(_arc(tail, tail_turn, 5)) + spine[-1]
    capsules += [
        (a, b, girth * w)
        for a, b, w in zip(ends[:-1], ends[1:], (0.6, 0.45, 0.36, 0.3), strict=True)
    ]
    for at, share in ((1, 1.0), (5, 1.15)):
        along = spine[at] - spine[at + 1]
        along = along / np.linalg.norm(along)
        across = np.array([-along[1], along[0], 0.0])
        for side in (-1, 1):
            swing = rng.uniform(-0.5, 0.5)
            knee = spine[at] + leg * share * (0.7 * side * across + swing * along - [0, 0, 0.25])
            foot = knee + leg * (0.25 * along - [0, 0, 0.6])
            capsules += [(spine[at], knee, 0.4 * girth), (knee, foot, 0.3 * girth)]
    return _surface(capsules)


def _arc(length: float, turn: float, num: int) -> FloatArray:
    """Return points along a plane arc that starts at the origin against x, shape (num, 3)."""
    angles = turn * np.linspace(0.0, 1.0, num - 1)
    steps = -length / (num - 1) * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _surface(capsules: list[tuple[FloatArray, FloatArray, float]]) -> Shape:
    """Return the smooth union of capsules (from, to, radius) as a closed mesh."""
    from skimage.measure import marching_cubes

    ends = np.array([[a, b] for a, b, _ in capsules])
    low, high = ends.min(axis=(0, 1)) - 0.4, ends.max(axis=(0, 1)) + 0.4
    cell = float((high - low).max()) / _RESOLUTION
    axes = [np.arange(start, end, cell) for start, end in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    near = sum(np.exp(-(_distance(points, a, b) - radius) / _BLEND) for a, b, radius in capsules)
    level = np.log(np.maximum(near, 1e-30))
    vertices, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        level, 0.0, gradient_direction="ascent"
    )
    return Shape.from_arrays(vertices * cell + low, faces.astype(np.int64), name="animal")


def _distance(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return how far points (..., 3) are from a segment."""
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[..., None] * along, axis=-1))
