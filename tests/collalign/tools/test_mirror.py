"""The other side of a bilateral surface is found, and a surface that has none is refused."""

import numpy as np
import pytest

from collalign.tools.variation.mirror import mirror_map
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import InputError
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape

pytestmark = pytest.mark.usefixtures("quick_search")


def horned(sides=(-1, 1), extra=0.0):
    """Return a body with horns on the sides named and a snout, in its own frame and turned."""
    points, faces = sphere_mesh(700)
    vertices = points * [1.0, 1.5, 0.8]
    bumps = [(np.array([0.7 * side, 0.5, 0.5]), 0.5) for side in sides]
    for place, height in [
        *bumps,
        (np.array([0.0, 1.0, 0.4]), 0.6),
        (np.array([0.9, -0.4, 0.1]), extra),
    ]:
        unit = place / np.linalg.norm(place)
        vertices = (
            vertices + height * np.exp(-((points - unit) ** 2).sum(axis=1) / 0.15)[:, None] * unit
        )
    turn = random_rotation(np.random.default_rng(2))
    return vertices, Shape.from_arrays(vertices @ turn.T + 3.0, faces, name="horned")


@pytest.mark.parametrize("extra", [0.0, 0.15])
def test_the_other_side_is_that_of_the_mirror_plane(extra):
    own, shape = horned(extra=extra)
    found = mirror_map(shape)
    error = np.linalg.norm(found.on(own) - own * [-1, 1, 1], axis=1)
    assert np.median(error) < 0.06
    assert np.linalg.norm(found.on(found.on(own)) - own, axis=1).mean() < 0.03, (
        "the counterpart of a counterpart"
    )
    wrong = np.linalg.norm(found.on(own) - own * [1, 1, -1], axis=1)
    assert np.median(wrong) > 0.5, "the check would notice another plane"


def test_what_has_no_other_side_is_refused():
    own, _ = horned()
    shape = Shape.from_arrays(own, sphere_mesh(700)[1], name="horned")
    angles = 2.0 * own[:, 1]
    twisted = np.column_stack(
        [
            np.cos(angles) * own[:, 0] - 0.4 * np.sin(angles) * own[:, 2],
            own[:, 1],
            np.sin(angles) * own[:, 0] + 0.4 * np.cos(angles) * own[:, 2],
        ]
    )
    assert np.isfinite(mirror_map(shape).on(own)).all()
    with pytest.raises(InputError, match="horned: is not bilateral"):
        mirror_map(Shape.from_arrays(twisted, shape.faces, name="horned"))
