import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob, sphere_mesh
from data_tools.errors import InputError
from data_tools.surface.laplacian import (
    cotangent_laplacian,
    spectrum,
    surface_operators,
)
from data_tools.surface.shape import Shape


@pytest.fixture(scope="module")
def sphere():
    return Shape.from_arrays(*sphere_mesh(2500), name="sphere")


def with_fin(shape):
    a, b, c = shape.faces[0]
    tip = shape.vertices[[a, b, c]].mean(axis=0) * 1.3
    faces = np.concatenate([shape.faces, [[a, b, len(shape.vertices)]]])
    return Shape.from_arrays(np.concatenate([shape.vertices, [tip]]), faces, name="finned")


@pytest.mark.parametrize("kind", ["cotangent", "tufted", "point cloud"])
def test_operators_are_symmetric_semidefinite_and_know_constants(kind):
    sphere = Shape.from_arrays(*sphere_mesh(600))
    shape = {
        "cotangent": sphere,
        "tufted": with_fin(sphere),
        "point cloud": Shape.from_arrays(sphere.vertices),
    }[kind]
    operators = surface_operators(shape)
    assert operators.kind == kind
    dense = operators.stiffness.toarray()
    np.testing.assert_allclose(dense, dense.T, atol=1e-12)
    np.testing.assert_allclose(dense.sum(axis=1), 0.0, atol=1e-9)
    assert np.linalg.eigvalsh(dense).min() > -1e-9
    assert operators.mass.min() > 0
    assert operators.mass.sum() == pytest.approx(4 * np.pi, rel=0.05)


def test_stiffness_of_one_triangle_is_known():
    operators = cotangent_laplacian(
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    )
    np.testing.assert_allclose(
        operators.stiffness.toarray(), [[1, -0.5, -0.5], [-0.5, 0.5, 0], [-0.5, 0, 0.5]]
    )
    np.testing.assert_allclose(operators.mass, 1 / 6)


def test_eigenfunctions_are_orthonormal_signed_and_repeatable(rng):
    shape = blob(rng, num_vertices=600)
    operators = surface_operators(shape)
    eigen = spectrum(operators, 12)
    again = spectrum(operators, 12)
    assert eigen.functions.tobytes() == again.functions.tobytes()
    gram = eigen.functions.T @ (eigen.mass[:, None] * eigen.functions)
    np.testing.assert_allclose(gram, np.eye(12), atol=1e-9)
    np.testing.assert_allclose(eigen.mass @ eigen.functions, 0.0, atol=1e-9)
    assert (eigen.mass @ eigen.functions**3 >= 0).all()
    residual = (
        operators.stiffness @ eigen.functions - eigen.mass[:, None] * eigen.functions * eigen.values
    )
    np.testing.assert_allclose(residual, 0.0, atol=1e-8)
    assert not eigen.functions.flags.writeable


def test_poor_surfaces_are_refused_by_name():
    with pytest.raises(InputError, match="tiny: 9 points are too few"):
        surface_operators(
            Shape.from_arrays(np.random.default_rng(0).standard_normal((9, 3)), name="tiny")
        )
    with pytest.raises(InputError, match="20 vertices are too few for 30"):
        spectrum(surface_operators(Shape.from_arrays(*sphere_mesh(20))), 30)
    vertices, faces = sphere_mesh(50)
    stray = Shape.from_arrays(np.concatenate([vertices, [[9.0, 9, 9]]]), faces, name="stray")
    with pytest.raises(InputError, match="stray: its cotangent Laplacian is not finite"):
        surface_operators(stray)


def test_points_on_a_line_have_no_laplacian_and_that_is_said_in_words():
    line = np.column_stack([np.arange(80.0), np.zeros((80, 2))])
    with pytest.raises(InputError, match="are not on a surface") as caught:
        surface_operators(Shape.from_arrays(line, np.empty((0, 3), dtype=int), name="line"))
    assert "ASSERT" not in str(caught.value)
