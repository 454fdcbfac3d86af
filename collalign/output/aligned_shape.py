"""One shape of a result, and shapes as objects of trimesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from collalign.products.pair import Alternative
from data_tools.arrays import FloatArray, one_line
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedShape:
    """One shape of a result.

    Attributes
    ----------
    name, file : str
        The file is empty where the shape came from memory.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    reflected : bool
    confidence : float
        NaN where it is not known.
    part : int
        Shapes of different parts are not aligned with each other.
    alternatives : tuple of Alternative
        Other poses, the likeliest first.
    """

    name: str
    file: str
    transform: FloatArray
    reflected: bool
    confidence: float
    part: int
    alternatives: tuple[Alternative, ...]

    __repr__ = one_line


def trimesh_of(shape: Shape) -> Any:
    """Return a shape as ``trimesh.Trimesh``, or ``trimesh.PointCloud`` where it has no faces."""
    import trimesh

    if not shape.is_mesh:
        return trimesh.PointCloud(shape.vertices.copy())
    return trimesh.Trimesh(shape.vertices.copy(), shape.faces.copy(), process=False)
