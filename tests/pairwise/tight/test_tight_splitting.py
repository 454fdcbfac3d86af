import numpy as np
import pytest

from pairwise.tight.lift import make_lift
from pairwise.tight.splitting import Blocks, Splitting, SumProjection, _definiteness, project_psd


def blocks_of(mask, unmatched):
    rows, cols = np.nonzero(mask)
    n, k = mask.shape
    if unmatched:
        rows, cols = np.append(rows, np.arange(n)), np.append(cols, np.full(n, k))
    return Blocks(rows=rows, cols=cols, costs=np.zeros((len(rows), 5)), num_rows=n, num_cols=k + unmatched)


def constraint_gap(blocks, one, x, mean):
    gaps = [abs(one @ mean - 1.0)]
    for i in range(blocks.num_rows):
        gaps.append(np.abs(x[blocks.rows == i].sum(axis=0) - mean).max())
    for j in range(blocks.num_cols):
        count = blocks.counts[blocks.num_rows + j]
        gaps.append(np.abs(x[blocks.cols == j].sum(axis=0) - count * mean).max())
    return max(gaps)


MASKS = {
    "square": (np.ones((4, 4), bool), 0),
    "wide": (np.ones((5, 3), bool), 1),
    "masked": (np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]], bool), 0),
    "masked wide": (np.array([[1, 0], [1, 1], [0, 1]], bool), 1),
}


@pytest.mark.parametrize("name", MASKS)
def test_sums_are_projected_orthogonally(name, rng):
    lift = make_lift("tight", 2)
    blocks = blocks_of(*MASKS[name])
    project = SumProjection(blocks, lift.one)
    y = rng.standard_normal((len(blocks.rows), 5))
    x, multipliers, mean = project(y)
    assert constraint_gap(blocks, lift.one, x, mean) < 1e-10
    again, _, _ = project(x)
    np.testing.assert_allclose(again, x, atol=1e-10)
    other, _, _ = project(rng.standard_normal(y.shape))
    assert abs(((x - y) * (other - x)).sum()) < 1e-9
    total = blocks.counts @ multipliers
    np.testing.assert_allclose(total, lift.one * (total @ lift.one) / (lift.one @ lift.one), atol=1e-10)
    assert constraint_gap(blocks, lift.one, y, mean) > 1e-3


def test_psd_projection_is_that_of_the_eigenvalues(rng):
    raw = rng.standard_normal((40, 6, 6))
    symmetric = raw + raw.transpose(0, 2, 1)
    symmetric[:10] -= 20.0 * np.eye(6)
    symmetric[10:20] += 20.0 * np.eye(6)
    symmetric[20] = 0.0
    values, vectors = np.linalg.eigh(symmetric)
    expected = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
    np.testing.assert_allclose(project_psd(symmetric), expected, atol=1e-10)
    assert not project_psd(symmetric)[:10].any()


def test_definite_blocks_are_told_from_mixed_ones(rng):
    raw = rng.standard_normal((60, 4, 4))
    blocks = raw + raw.transpose(0, 2, 1) + rng.choice([-3.0, 0.0, 3.0], 60)[:, None, None] * np.eye(4)
    blocks[0] = np.diag([-1.0, -1.0, 0.5, -1.0])
    blocks[1] = 0.25 * np.diag([1.0, 2.0, -1.0, 3.0])
    blocks[2] = np.diag([0.5, 0.5, 0.5, 0.5])
    values = np.linalg.eigvalsh(blocks)
    negative, positive = _definiteness(blocks)
    np.testing.assert_array_equal(negative, (values < 0).all(axis=1))
    np.testing.assert_array_equal(positive, (values > 0).all(axis=1))
    assert 0 < negative.sum() < 60


def test_a_new_splitting_describes_its_first_point(rng):
    lift = make_lift("tight", 2)
    blocks = blocks_of(*MASKS["square"])
    size = lift.flat_basis.shape[0] ** 0.5
    v = np.zeros((len(blocks.rows), round(size), round(size)))
    splitting = Splitting(lift=lift, blocks=blocks, rho=1.0, v=v)
    assert not splitting.psd.any()
    assert constraint_gap(blocks, lift.one, splitting.x, splitting.mean) < 1e-10
