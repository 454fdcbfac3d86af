"""The Laplace-Beltrami operator of meshes and point clouds, and its eigenfunctions.

Conventions: the stiffness matrix S is symmetric and positive semidefinite, its rows sum to zero; the mass matrix M
is diagonal; eigenpairs solve S phi = lambda M phi with phi orthonormal in M.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import robust_laplacian
import scipy

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import InputError
from data_tools.surface.shape import Shape
from data_tools.surface.topology import counted_edges, face_areas
from data_tools.threads import one_blas_thread

#: Neighbours of a point in clouds.
NUM_CLOUD_NEIGHBOURS = 16
#: Cotangent weights beyond this mean needle triangles: the tufted Laplacian is used.
MAX_COTANGENT = 1e4
#: Shift of the shift-invert iteration, for surfaces of unit area (whose first eigenvalues are about 10).
SPECTRUM_SHIFT = -0.01


@dataclass(frozen=True, eq=False)
class SurfaceOperators:
    """Stiffness and mass of a surface.

    Attributes
    ----------
    stiffness : csc_array, shape (v, v)
        Symmetric positive semidefinite; dimensionless.
    mass : ndarray, shape (v,)
        The area that belongs to each vertex, in squared units.
    kind : str
        "cotangent", "tufted" or "point cloud".
    """

    stiffness: scipy.sparse.csc_array
    mass: FloatArray
    kind: str


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenpairs of the surface scaled to unit area, without the constant one.

    Attributes
    ----------
    values : ndarray, shape (m,)
        Ascending, dimensionless: lambda times the area.
    functions : ndarray, shape (v, m)
        Orthonormal in ``mass``. The sign of each is such that its area-weighted third moment is positive.
    mass : ndarray, shape (v,)
        Sums to 1.
    kind : str
        See :class:`SurfaceOperators`.
    """

    values: FloatArray
    functions: FloatArray
    mass: FloatArray
    kind: str


def cotangent_laplacian(vertices: FloatArray, faces: IntArray) -> SurfaceOperators:
    """Return the cotangent stiffness matrix and the barycentric lumped mass of a mesh.

    S_ij = -(cot a_ij + cot b_ij) / 2 for an edge with opposite angles a and b (Pinkall and Polthier 1993).

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
    faces : ndarray of int, shape (f, 3)
        Without degenerate triangles; every vertex in at least one.
    """
    num = len(vertices)
    cotangents = _cotangents(vertices, faces)
    rows = faces[:, [1, 2, 0]].ravel()
    cols = faces[:, [2, 0, 1]].ravel()
    half = scipy.sparse.coo_array(
        (0.5 * cotangents.ravel(), (rows, cols)), shape=(num, num)
    ).tocsc()
    weights = half + half.T
    stiffness = scipy.sparse.diags_array(weights.sum(axis=1)) - weights
    return SurfaceOperators(
        scipy.sparse.csc_array(stiffness), _lumped_areas(vertices, faces), "cotangent"
    )


def surface_operators(shape: Shape) -> SurfaceOperators:
    """Return the operators that suit a shape.

    Cotangents on good meshes; the tufted Laplacian (Sharp and Crane 2020) on meshes with edges of more than two
    triangles or with needle triangles, and its point cloud form without triangles.

    Raises
    ------
    InputError
        If a point cloud has too few points, or the operator is not finite.
    """
    if not shape.is_mesh and len(shape.vertices) <= NUM_CLOUD_NEIGHBOURS:
        raise InputError(
            f"{shape.name}: {len(shape.vertices)} points are too few for a surface, and so for its Laplacian"
        )
    if shape.is_mesh and _is_good(shape.vertices, shape.faces):
        operators = cotangent_laplacian(shape.vertices, shape.faces)
    else:
        operators = _tufted_operators(shape)
    if not (np.isfinite(operators.stiffness.data).all() and (operators.mass > 0).all()):
        raise InputError(
            f"{shape.name}: its {operators.kind} Laplacian is not finite, the surface is too poor"
        )
    return operators


def vertex_areas(shape: Shape) -> FloatArray:
    """Return the area of each vertex in squared units, shape (v,).

    A third of the triangles around it; in a point cloud that of the disc of its 16 nearest neighbours, divided by
    their number.
    """
    if shape.is_mesh:
        return _lumped_areas(shape.vertices, shape.faces)
    num = min(NUM_CLOUD_NEIGHBOURS, len(shape.vertices) - 1)
    distances, _ = scipy.spatial.cKDTree(shape.vertices).query(shape.vertices, k=num + 1)
    return np.pi * distances[:, -1] ** 2 / num


@one_blas_thread()
def spectrum(operators: SurfaceOperators, num: int, *, name: str = "shape") -> Spectrum:
    """Return the ``num`` lowest non-constant eigenpairs of the surface scaled to unit area.

    Shift-invert Lanczos with a fixed start vector: the same bytes every time. A surface of several components has
    one constant function each; those beyond the first count as eigenfunctions with value 0.

    Raises
    ------
    InputError
        If the surface has too few vertices, or the iteration fails.
    """
    num_vertices = len(operators.mass)
    if num > num_vertices - 2:
        raise InputError(f"{name}: {num_vertices} vertices are too few for {num} eigenfunctions")
    mass = operators.mass / operators.mass.sum()
    start = np.random.default_rng(0).standard_normal(num_vertices)
    # M is diagonal: with psi = M^(1/2) phi the problem is a plain one.
    roots = np.sqrt(mass)
    scaling = scipy.sparse.diags_array(1.0 / roots)
    matrix = scipy.sparse.csc_array(scaling @ operators.stiffness @ scaling)
    try:
        values, functions = scipy.sparse.linalg.eigsh(
            matrix,
            k=num + 1,
            sigma=SPECTRUM_SHIFT,
            v0=start,
            tol=1e-9,
            OPinv=_shifted_inverse(matrix),
        )
    except (scipy.sparse.linalg.ArpackError, RuntimeError) as error:
        raise InputError(
            f"{name}: the eigenfunctions of its surface could not be computed ({error})"
        ) from error
    order = np.argsort(values)[1:]
    functions = functions[:, order] / roots[:, None]
    signs = np.where(mass @ (functions * functions**2) < 0, -1.0, 1.0)
    return Spectrum(
        read_only(np.maximum(values[order], 0.0)),
        read_only(np.ascontiguousarray(functions * signs)),
        read_only(mass),
        operators.kind,
    )


def _shifted_inverse(matrix: scipy.sparse.csc_array) -> scipy.sparse.linalg.LinearOperator:
    """Return the inverse of a positive semidefinite matrix minus the shift."""
    shifted = scipy.sparse.csc_array(
        matrix - SPECTRUM_SHIFT * scipy.sparse.diags_array(np.ones(matrix.shape[0]))
    )
    return scipy.sparse.linalg.LinearOperator(
        matrix.shape, matvec=factor_symmetric(shifted).solve, dtype=np.float64
    )


def factor_symmetric(
    matrix: scipy.sparse.csc_array | scipy.sparse.csc_matrix,
) -> scipy.sparse.linalg.SuperLU:
    """Factor a symmetric positive definite matrix.

    Ordered for symmetric matrices and without pivoting, which a positive definite one does not need, the factors have
    half the entries of those that SuperLU finds by default.
    """
    options = {"SymmetricMode": True}
    return scipy.sparse.linalg.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
    )


def _cotangents(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the cotangent of the angle at each corner, shape (f, 3)."""
    corners = vertices[faces]
    to_next = np.roll(corners, -1, axis=1) - corners
    to_last = np.roll(corners, 1, axis=1) - corners
    doubled_area = np.linalg.norm(np.cross(to_next[:, 0], to_last[:, 0]), axis=1)
    return (to_next * to_last).sum(axis=2) / doubled_area[:, None]


def _lumped_areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    thirds = np.repeat(face_areas(vertices, faces) / 3.0, 3)
    return np.bincount(faces.ravel(), weights=thirds, minlength=len(vertices)).astype(np.float64)


def _tufted_operators(shape: Shape) -> SurfaceOperators:
    """Return the tufted Laplacian of a mesh, or its point cloud form."""
    kind = "tufted" if shape.is_mesh else "point cloud"
    try:
        if shape.is_mesh:
            stiffness, mass = robust_laplacian.mesh_laplacian(shape.vertices, shape.faces)
        else:
            centred = shape.vertices - shape.vertices.mean(
                axis=0
            )  # its triangles depend on where the origin is
            stiffness, mass = robust_laplacian.point_cloud_laplacian(
                centred, n_neighbors=NUM_CLOUD_NEIGHBOURS
            )
    except RuntimeError:  # its message names lines of C++, not what is wrong with the shape
        raise InputError(
            f"{shape.name}: no {kind} Laplacian can be built, because its points are not on a surface. "
            "They are on a line, or around a single triangle"
        ) from None
    return SurfaceOperators(scipy.sparse.csc_array(stiffness), np.array(mass.diagonal()), kind)


def _is_good(vertices: FloatArray, faces: IntArray) -> bool:
    with np.errstate(divide="ignore", invalid="ignore"):
        largest = np.abs(_cotangents(vertices, faces)).max()
    return bool(largest < MAX_COTANGENT) and int(counted_edges(faces)[1].max()) <= 2
