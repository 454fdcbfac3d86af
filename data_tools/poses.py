"""Poses: similarities of one shape or of many, as they are found and as 4 x 4 transforms of files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from data_tools.arrays import BoolArray, FloatArray, IntArray
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg

#: Rotations nearer than this lead local search to one minimum: they are one candidate.
SAME_DEG = 15.0
#: A pose agrees with another one within this: matches of few samples of shapes that differ are as accurate as that.
AGREE_DEG = 20.0
#: Poses farther apart than this are different answers, which no refinement takes into each other; twelfths of a turn
#: are, whatever their last bits.
APART_DEG = 29.99


@dataclass(frozen=True, kw_only=True, eq=False)
class Similarity:
    """x -> scale * rotation x + shift; one pose, or several along a first axis.

    Attributes
    ----------
    rotation : ndarray, shape (d, d) or (p, d, d)
        Orthogonal, of either determinant.
    scale : float, or ndarray, shape (p,)
    shift : ndarray, shape (d,) or (p, d)
    """

    rotation: FloatArray
    scale: Any
    shift: FloatArray

    @classmethod
    def rigid(cls, rotations: FloatArray, shifts: FloatArray) -> Similarity:
        """Return the poses of scale 1 with rotations (p, d, d) and shifts (p, d)."""
        return cls(rotation=rotations, scale=np.ones(len(shifts)), shift=shifts)

    @classmethod
    def of_transforms(cls, transforms: FloatArray) -> Similarity:
        """Return the poses that transforms are, shape (4, 4) or (p, 4, 4)."""
        scale = scales_of(transforms)
        return cls(
            rotation=transforms[..., :3, :3] / scale[..., None, None],
            scale=scale,
            shift=np.ascontiguousarray(transforms[..., :3, 3]),
        )

    def __len__(self) -> int:
        return len(self.shift)

    def __getitem__(self, which: IntArray | BoolArray | slice | int) -> Similarity:
        """Return some of several poses."""
        return Similarity(
            rotation=self.rotation[which], scale=self.scale[which], shift=self.shift[which]
        )

    @property
    def transform(self) -> FloatArray:
        """The same as a matrix, shape (4, 4), or as several, shape (p, 4, 4); of poses in space."""
        found = np.zeros((*self.shift.shape[:-1], 4, 4))
        found[..., :3, :3] = np.asarray(self.scale)[..., None, None] * self.rotation
        found[..., :3, 3], found[..., 3, 3] = self.shift, 1.0
        return found

    def apply(self, points: FloatArray) -> FloatArray:
        """Return the points where the poses take them, shape (l, d) or (p, l, d)."""
        scaled = np.asarray(self.scale)[..., None, None] * points
        return np.asarray(scaled @ np.swapaxes(self.rotation, -1, -2) + self.shift[..., None, :])

    def undo(self, points: FloatArray) -> FloatArray:
        """Return the points that the poses take to these, shape (l, d) or (p, l, d)."""
        return np.asarray(
            (points - self.shift[..., None, :])
            @ self.rotation
            / np.asarray(self.scale)[..., None, None]
        )


def moved_by(transform: FloatArray, points: FloatArray) -> FloatArray:
    """Return points, shape (..., 3), where a 4 x 4 transform takes them."""
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def each_moved_by(transforms: FloatArray, points: FloatArray) -> FloatArray:
    """Return the points of each shape, shape (N, k, 3), where its own transform of (N, 4, 4) takes them."""
    return np.asarray(
        points @ np.swapaxes(transforms[:, :3, :3], 1, 2) + transforms[:, None, :3, 3]
    )


def scales_of(transforms: FloatArray) -> FloatArray:
    """Return the scale of similarities given as matrices, shape (..., 3 or 4, 3 or 4), whether they mirror or not."""
    return np.asarray(np.cbrt(np.abs(np.linalg.det(transforms[..., :3, :3]))))


def pose_angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angle between rotations in degrees, shape (...); 180 where one mirrors and the other does not."""
    return np.nan_to_num(rotation_angle_deg(a, b), nan=180.0)


def keep_apart(rotations: FloatArray, least_deg: float, *, num: int | None = None) -> list[int]:
    """Return the positions of at most ``num`` rotations, in their order, each that far from all kept before it.

    Parameters
    ----------
    rotations : ndarray, shape (p, 3, 3)
        The best first.
    least_deg : float
        Rotations that are no farther apart are one.
    num : int, optional
    """
    kept, free = list[int](), np.ones(len(rotations), dtype=np.bool_)
    while free.any() and len(kept) != num:
        kept.append(at := int(free.argmax()))
        free &= pose_angle_deg(rotations, rotations[at]) > least_deg
        free[at] = False
    return kept


def fitting_similarity(
    to: FloatArray, of: FloatArray, weights: FloatArray, *, may_rotate: bool = True
) -> FloatArray:
    """Return the similarity that brings points to their counterparts best, shape (..., 4, 4), never a mirror image.

    Parameters
    ----------
    to, of : ndarray, shape (..., p, 3)
    weights : ndarray, shape (p,)
        Not negative, and not all zero.
    may_rotate : bool
        Whether it may rotate, in addition to shifting and scaling.

    References
    ----------
    Umeyama 1991. The scale is the symmetric one, the ratio of both sizes: least squares would shrink the source the
    more, the worse points correspond.
    """
    shares = weights / weights.sum()
    mean_to, mean_of = shares @ to, shares @ of
    centred_to, centred_of = to - mean_to[..., None, :], of - mean_of[..., None, :]
    pose = np.zeros((*to.shape[:-2], 4, 4))
    pose[...] = np.eye(4)
    if may_rotate:
        products = np.swapaxes(centred_to, -2, -1) @ (shares[:, None] * centred_of)
        pose[..., :3, :3] = nearest_orthogonal(products, determinant=1.0)
    size_to, size_of = ((points**2).sum(axis=-1) @ shares for points in (centred_to, centred_of))
    has_size = np.minimum(size_to, size_of) > 0
    scale = np.sqrt(np.where(has_size, size_to, 1.0) / np.where(has_size, size_of, 1.0))
    pose[..., :3, :3] *= scale[..., None, None]
    pose[..., :3, 3] = mean_to - (pose[..., :3, :3] @ mean_of[..., None])[..., 0]
    return pose
