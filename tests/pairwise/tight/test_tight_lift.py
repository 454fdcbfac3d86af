import numpy as np
import pytest

from data_tools.errors import OptionsError
from pairwise.local.rotation_sets import random_rotations
from pairwise.tight.lift import make_lift

LIFTS = [("tight", 3), ("quaternion", 3), ("tight", 2), ("quaternion", 2)]


def lifted(form, dim, num=60, seed=0):
    lift = make_lift(form, dim)
    rotations = random_rotations(dim, num, np.random.default_rng(seed))
    z = lift.vectors(rotations)
    return lift, rotations, z[:, :, None] * z[:, None, :]


@pytest.mark.parametrize(("form", "dim"), LIFTS)
def test_identities_hold_and_entries_give_the_rotation(form, dim):
    lift, rotations, blocks = lifted(form, dim)
    assert np.abs(np.einsum("cab,nab->nc", lift.identities, blocks)).max(initial=0.0) < 1e-12
    np.testing.assert_allclose(lift.mean_rotations(blocks), rotations, atol=1e-12)
    np.testing.assert_allclose(np.trace(blocks, axis1=1, axis2=2), lift.trace, atol=1e-12)


@pytest.mark.parametrize(("form", "dim"), LIFTS)
def test_the_basis_spans_exactly_the_lifted_rotations(form, dim):
    lift, _, blocks = lifted(form, dim)
    flat = blocks.reshape(len(blocks), -1)
    assert np.linalg.matrix_rank(flat) == len(lift.basis)
    np.testing.assert_allclose(flat @ lift.flat_basis @ lift.flat_basis.T, flat, atol=1e-12)
    np.testing.assert_allclose(lift.flat_basis.T @ lift.flat_basis, np.eye(len(lift.basis)), atol=1e-12)


def test_span_has_the_dimension_of_quartic_forms():
    assert len(make_lift("tight", 3).basis) == 35
    assert len(make_lift("tight", 2).basis) == 5


@pytest.mark.parametrize(("form", "dim"), LIFTS)
def test_cost_coordinates_are_the_cost(form, dim):
    lift, rotations, blocks = lifted(form, dim)
    rng = np.random.default_rng(1)
    constants, slopes = rng.standard_normal(60), rng.standard_normal((60, dim, dim))
    values = (lift.cost_coordinates(constants, slopes) * (blocks.reshape(60, -1) @ lift.flat_basis)).sum(axis=1)
    np.testing.assert_allclose(values, constants + (slopes * rotations).sum(axis=(1, 2)), atol=1e-12)


@pytest.mark.parametrize(("form", "dim"), LIFTS)
def test_full_moments_of_one_rotation_are_rank_one(form, dim):
    lift, rotations, blocks = lifted(form, dim)
    z = np.append(1.0, rotations[0].T.ravel())
    np.testing.assert_allclose(lift.full_moments(blocks[0]), np.outer(z, z), atol=1e-12)


def test_full_moments_of_a_mixture_have_its_mean():
    for form, dim in LIFTS:
        lift, rotations, blocks = lifted(form, dim)
        moments = lift.full_moments(0.3 * blocks[0] + 0.7 * blocks[1])
        np.testing.assert_allclose(moments[0, 1:], (0.3 * rotations[0] + 0.7 * rotations[1]).T.ravel(), atol=1e-12)
        assert moments[0, 0] == pytest.approx(1.0)


def test_other_dimensions_and_forms_are_refused():
    with pytest.raises(OptionsError, match="dimension 2 or 3"):
        make_lift("tight", 4)
    with pytest.raises(OptionsError, match="form"):
        make_lift("loose", 3)
