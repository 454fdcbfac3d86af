from itertools import product

import numpy as np
import pytest

from data_tools.rotations import rotation_angles
from pairwise.branch_and_bound.bounds import Cells
from pairwise.rotation_sets import quaternions_to_rotations, random_rotations


def split_at_random(dim, rng, num=40):
    """Leaves of a tree in which random cells were split."""
    cells = Cells.whole(dim)
    for _ in range(num):
        chosen = rng.integers(len(cells))
        rest = np.delete(np.arange(len(cells)), chosen)
        cells = cells.take(rest).join(cells.take(np.array([chosen])).split())
    return cells


@pytest.mark.parametrize("dim", [2, 3])
def test_every_rotation_lies_in_the_ball_of_a_leaf(dim, rng):
    cells = split_at_random(dim, rng)
    centres, radii = cells.balls()
    rotations = random_rotations(dim, 400, rng)
    assert (rotation_angles(rotations[:, None], centres) <= radii).any(axis=1).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_paths_of_leaves_tile_their_faces(dim, rng):
    cells = split_at_random(dim, rng)
    for face in range(4 if dim == 3 else 1):
        own = cells.faces == face
        starts = cells.paths[own] / 2.0 ** cells.depths[own]
        order = np.argsort(starts)
        ends = starts + 0.5 ** cells.depths[own]
        np.testing.assert_array_equal(ends[order], np.append(starts[order][1:], 1.0))


@pytest.mark.parametrize("dim", [2, 3])
def test_the_farthest_corner_of_a_cell_is_on_the_surface_of_its_ball(dim, rng):
    cells = split_at_random(dim, rng)
    signs = np.array(list(product([-1.0, 1.0], repeat=cells.centres.shape[1])))
    corners = cells.centres[:, None] + cells.halves[:, None] * signs
    if dim == 2:
        cos, sin = np.cos(np.pi * corners[..., 0]), np.sin(np.pi * corners[..., 0])
        rotations = np.stack(
            [np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2
        )
    else:
        quaternions = np.ones((*corners.shape[:2], 4))
        for face in range(4):
            own = cells.faces == face
            quaternions[own] = np.insert(np.tan(np.pi / 4.0 * corners[own]), face, 1.0, axis=-1)
        quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
        rotations = quaternions_to_rotations(quaternions)
    centres, radii = cells.balls()
    farthest = rotation_angles(rotations, centres[:, None]).max(axis=1)
    assert (farthest <= radii).all()
    np.testing.assert_allclose(farthest, radii, atol=1e-6)
