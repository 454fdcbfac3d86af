"""Repeated measurements of individuals, against R and what is known."""

import numpy as np
import pytest

from collalign.analysis.measurement_error import measurement_error
from data_tools.errors import InputError
from tests.r_expected import check_expected, landmark_shapes


def test_repeatability_is_that_of_r():
    points, individuals, sides = landmark_shapes()
    right = [at for at in range(32) if sides[at] == "R"]
    for name, chosen in (
        ("repeats", right),
        ("unequal-repeats", [one for at, one in enumerate(right) if at not in (0, 3)]),
    ):
        found = measurement_error(points[chosen], [individuals[at] for at in chosen])
        values = {"repeatability": found.repeatability, "r2": found.r2, "f": found.anova[0].f}
        check_expected({f"{name}-{what}": value for what, value in values.items()})


def repeated(rng, *, num=40, repeats=3, individual=0.05, error=0.05):
    """Return shapes of equal variance among and within individuals, but for what superimposition takes up."""
    base = rng.standard_normal((10, 3))
    own = base + individual * rng.standard_normal((num, 10, 3))
    shapes = np.repeat(own, repeats, axis=0)
    shapes = shapes + error * rng.standard_normal(shapes.shape)
    return shapes, [f"i{at}" for at in np.repeat(np.arange(num), repeats).tolist()]


def test_repeats_that_tell_nothing_are_refused():
    shapes, individuals = repeated(np.random.default_rng(10), num=3)
    for wrong in (["a"] * 9, [f"{at}" for at in range(9)], [""] * 9):
        with pytest.raises(InputError, match="measured twice"):
            measurement_error(shapes, wrong)
    with pytest.raises(InputError, match="individuals: 8 labels"):
        measurement_error(shapes, individuals[:8])
