"""What the outside of a surface adds to its inside: normals, smoothed mean curvature, and orientation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from data_tools.arrays import FloatArray, read_only
from data_tools.surface.laplacian import SurfaceOperators
from data_tools.surface.normals import vertex_normals
from data_tools.surface.shape import Shape
from data_tools.surface.topology import face_areas

#: Lowest functions of the target whose orientation is compared; the source needs more to represent them.
NUM_FORM_FUNCTIONS = 6


def outward(shape: Shape) -> Shape:
    """Return the mesh with its triangles counterclockwise from outside, judged by the sign of its volume."""
    if signed_volume(shape) >= 0:
        return shape
    return replace(shape, faces=read_only(np.ascontiguousarray(shape.faces[:, ::-1])))


def signed_volume(shape: Shape) -> float:
    """Return the volume inside a mesh (of an open one, of the cone from its centroid); negative if inside out."""
    a, b, c = (shape.vertices[shape.faces[:, i]] - shape.vertices.mean(axis=0) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def smoothed_curvature(shape: Shape, operators: SurfaceOperators, *, time: float) -> FloatArray:
    """Return the mean curvature of the smoothed surface, times sqrt(area), shape (v,); positive where convex.

    Positions take two implicit steps of the heat flow (Desbrun et al. 1999), half the normal part of their Laplacian
    takes a third one; so the triangulation hardly matters. Values beyond the central 98 % are clipped: they belong to
    single sharp vertices.

    Parameters
    ----------
    shape : Shape
        A mesh with outward normals.
    operators : SurfaceOperators
        Of the shape.
    time : float
        Step of the flow at unit area: features larger than about sqrt(time) survive.
    """
    mass = diags_array(operators.mass).tocsc()
    step = splu((mass + (time * shape.area) * operators.stiffness).tocsc())
    positions = shape.vertices
    for _ in range(2):
        positions = step.solve(mass @ positions)
    bending = ((operators.stiffness @ positions) * vertex_normals(shape.vertices, shape.faces)).sum(axis=1)
    curvature = 0.5 * np.sqrt(shape.area) * step.solve(bending)
    return np.clip(curvature, *np.quantile(curvature, [0.01, 0.99]))


def orientation_form(shape: Shape, functions: FloatArray) -> FloatArray:
    """Return n . (grad f_a x grad f_b), times the area, at every vertex for all pairs of functions, shape (v, m, m).

    Antisymmetric in (a, b). A map that preserves orientation pulls the form of one shape back to that of the other,
    a mirrored map to its negative (Ren et al. 2018 use the same form as an operator).

    Parameters
    ----------
    shape : Shape
        A mesh with outward normals.
    functions : ndarray, shape (v, m)
        A few smooth functions.
    """
    values = functions[shape.faces]
    along, across = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    wedge = along[:, :, None] * across[:, None, :]
    wedge = wedge - np.swapaxes(wedge, 1, 2)
    around = _around(shape)
    doubled_areas = around @ (2.0 * face_areas(shape.vertices, shape.faces))
    sums = (around @ wedge.reshape(len(wedge), -1)).reshape(-1, *wedge.shape[1:])
    return sums * (shape.area / np.where(doubled_areas > 0, doubled_areas, 1.0))[:, None, None]


def _around(shape: Shape) -> csr_array:
    """Return the (v, f) matrix that sums over the triangles around each vertex."""
    num_faces = len(shape.faces)
    columns = np.repeat(np.arange(num_faces), 3)
    entries = (np.ones(3 * num_faces), (shape.faces.ravel(), columns))
    return coo_array(entries, shape=(len(shape.vertices), num_faces)).tocsr()
