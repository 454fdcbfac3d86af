"""Sliding against geomorph, and what must hold of any of it."""

from pathlib import Path

import numpy as np
import pytest

from collalign.analysis.procrustes import best_rotations, unit_size
from collalign.analysis.sliding import bending_matrix, slide_semilandmarks
from data_tools.errors import InputError, OptionsError
from data_tools.rotations import random_rotation

NUM = 12
#: Ends and four landmarks off the curve stay.
SLIDERS = np.column_stack([np.arange(NUM - 2), np.arange(1, NUM - 1), np.arange(2, NUM)])
FIXED = np.array([[1.0, 1.0, 1.0], [-1.0, 0.5, 1.5], [0.5, -1.0, -1.0], [2.0, 0.0, 0.5]])


def shapes(rng, uneven=0.0, num=5):
    """Return arcs with landmarks beside them, in any pose and size; points of each are spaced unevenly."""
    made = []
    for _ in range(num):
        angles = np.linspace(0, 2, NUM)
        angles[1:-1] += uneven * rng.uniform(-1, 1, NUM - 2) * (angles[1] - angles[0])
        stretch = 1 + 0.05 * rng.standard_normal(3)
        curve = np.column_stack([np.cos(angles), np.sin(angles), 0.2 * angles])
        both = np.concatenate([curve, FIXED]) * stretch
        made.append(rng.uniform(0.5, 2) * both @ random_rotation(rng).T + rng.random(3))
    return np.array(made)


#: Seven shapes of a curve, a grid on a surface and four landmarks, the first of which is the mean of the others; and
#: what ``gpagen(A, curves = cbind(1:6, 2:7, 3:8), surfaces = 9:24, PrinAxes = FALSE, Proj = FALSE, ProcD = ...)``
#: makes of them: by the functions of github.com/geomorphR/geomorph, 00bb4e26, in R 4.2.2.
GPAGEN = Path(__file__).parents[2] / "integrations" / "sliding" / "gpagen.csv"


def of_gpagen(criterion):
    """Return the stored shapes and what geomorph slid them to, each of shape (7, 28, 3)."""
    table = np.genfromtxt(GPAGEN, delimiter=",", names=True)
    columns = [[*"xyz"], [f"{criterion}_{axis}" for axis in "xyz"]]
    return [np.column_stack([table[one] for one in few]).reshape(7, 28, 3) for few in columns]


@pytest.mark.parametrize("criterion", ["bending", "procrustes"])
def test_the_answer_is_that_of_geomorph(criterion):
    points, expected = of_gpagen(criterion)
    curve = np.column_stack([np.arange(6), np.arange(1, 7), np.arange(2, 8)])
    slid = slide_semilandmarks(points, curve, range(8, 24), criterion=criterion)
    assert apart(slid, expected) < 1e-9
    assert apart(points, expected) > 1e-2
    once = slide_semilandmarks(slid, curve, range(8, 24), criterion=criterion)
    assert apart(once, expected) > 1e-5


def test_the_order_of_shapes_does_not_matter(rng):
    points = shapes(rng, uneven=0.4)
    slid = slide_semilandmarks(points, SLIDERS)
    np.testing.assert_allclose(slide_semilandmarks(points[::-1], SLIDERS), slid[::-1], atol=1e-8)


def apart(shapes, others):
    """Return the largest distance of a point from that of another shape, both superimposed by themselves."""
    one, other = unit_size(shapes), unit_size(others)
    turned = one @ np.swapaxes(best_rotations(other, one), 1, 2)
    return np.linalg.norm(turned - other, axis=2).max()


def test_affine_displacements_do_not_bend_and_others_do(rng):
    reference = rng.standard_normal((10, 3))
    energy = bending_matrix(reference)
    assert np.abs(energy @ (reference @ rng.standard_normal((3, 3)) + 1.0)).max() < 1e-9
    other = rng.standard_normal(10)
    assert other @ energy @ other > 0
    assert np.linalg.eigvalsh(energy).min() > -1e-9


def test_what_cannot_slide_is_refused(rng):
    points = shapes(rng)
    with pytest.raises(InputError, match="at least two shapes"):
        slide_semilandmarks(points[:1], SLIDERS)
    with pytest.raises(InputError, match="none of the 16 points"):
        slide_semilandmarks(points, [[0, 1, 16]])
    with pytest.raises(OptionsError, match="criterion"):
        slide_semilandmarks(points, SLIDERS, criterion="least")
