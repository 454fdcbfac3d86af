"""Left and right of individuals, against R, dense sums and what is known."""

import numpy as np
import pytest

from collalign.analysis.paired_sides import paired_sides
from data_tools.errors import InputError
from data_tools.rotations import random_rotation
from tests.r_expected import check_expected, landmark_shapes

MIRROR = np.array([-1.0, 1.0, 1.0])


def by_effect(anova):
    return {row.effect: row for row in anova}


def family(rng, *, num=12, repeats=1, individual=0.1, directional=0.0, fluctuating=0.05, error=0.0):
    """Return left and right shapes (N, 10, 3) in random poses and sizes, individuals and sides; left are mirrored."""
    base, one_sided = rng.standard_normal((2, 10, 3))
    shapes, individuals, sides = [], [], []
    for at in range(num):
        own = base + individual * rng.standard_normal((10, 3))
        for side in "LR":
            here = own + fluctuating * rng.standard_normal((10, 3))
            here = here + directional * one_sided * (side == "L")
            for _ in range(repeats):
                again = here + error * rng.standard_normal((10, 3))
                again = again * (MIRROR if side == "L" else 1.0)
                shapes.append(rng.uniform(0.5, 3) * again @ random_rotation(rng).T + rng.random(3))
                individuals.append(f"i{at}")
                sides.append(side)
    return np.array(shapes), individuals, sides


def of_r(name, chosen):
    """Compare the shapes that are chosen with what R found of them."""
    points, individuals, sides = landmark_shapes()
    found = paired_sides(
        points[chosen],
        [individuals[at] for at in chosen],
        [sides[at] for at in chosen],
        mirrored="L",
        permutations=99,
    )
    rows = by_effect(found.anova)
    rows["interaction"] = rows.pop("individual:side")
    del rows["total"]
    values = {f"{name}-ss-{effect}": row.sum_of_squares for effect, row in rows.items()}
    values |= {f"{name}-f-{effect}": row.f for effect, row in rows.items() if not np.isnan(row.f)}
    asymmetry = zip(found.individuals, found.asymmetry, strict=True)
    values |= {f"{name}-asymmetry-{who}": one for who, one in asymmetry}
    check_expected(values)
    return values


def test_sums_of_squares_f_and_asymmetries_are_those_of_r():
    assert len(of_r("replicated", range(32))) == 4 + 3 + 8
    assert len(of_r("single", range(0, 32, 2))) == 3 + 2 + 8
    unequal = of_r("unequal", [at for at in range(32) if at not in (0, 6)])
    check_expected({name: value * (1 + 1e-10) for name, value in unequal.items()})
    with pytest.raises(AssertionError, match="unequal"):
        check_expected({name: value * (1 + 1e-7) for name, value in unequal.items()})


def test_p_is_as_often_small_as_it_says_where_there_is_nothing():
    rng = np.random.default_rng(5)
    for individual, fluctuating, effects in (
        (0.1, 0.05, ["side"]),
        (0.0, 0.0, ["individual", "side", "individual:side"]),
        (0.0, 0.05, ["individual"]),
    ):
        found = [
            by_effect(
                paired_sides(
                    *family(
                        rng,
                        num=6,
                        individual=individual,
                        fluctuating=fluctuating,
                        error=0.02,
                        repeats=2,
                    ),
                    mirrored="L",
                    permutations=99,
                ).anova
            )
            for _ in range(50)
        ]
        for effect in effects:
            p = np.array([rows[effect].p for rows in found])
            assert 0.3 < p.mean() < 0.7, effect
            assert np.mean(p <= 0.05) < 0.16, effect


def test_who_lacks_a_side_does_not_count():
    shapes, individuals, sides = family(np.random.default_rng(6), num=6)
    whole = paired_sides(shapes[2:], individuals[2:], sides[2:], mirrored="L", permutations=99)
    for changed in (
        (shapes[1:], individuals[1:], sides[1:]),
        (shapes, individuals, ["", *sides[1:]]),
    ):
        found = paired_sides(*changed, mirrored="L", permutations=99)
        assert found.left_out == ("i0",)
        assert found.individuals == whole.individuals
        np.testing.assert_allclose(found.asymmetry, whole.asymmetry, rtol=1e-8)
    unknown = paired_sides(shapes, ["", "", *individuals[2:]], sides, permutations=99)
    assert unknown.left_out == ()


def test_what_are_no_two_sides_is_refused():
    shapes, individuals, sides = family(np.random.default_rng(7), num=3)
    with pytest.raises(InputError, match="two sides, got L, R, x"):
        paired_sides(shapes, individuals, ["x", *sides[1:]])
    with pytest.raises(InputError, match="two sides, got none"):
        paired_sides(shapes, individuals, [""] * 6)
    with pytest.raises(InputError, match="0 individuals have both"):
        paired_sides(shapes, [f"{at}" for at in range(6)], sides)
    with pytest.raises(InputError, match="mirrored: expected one of the sides L, R"):
        paired_sides(shapes, individuals, sides, mirrored="left")
    with pytest.raises(InputError, match="sides: 5 labels for 6 shapes"):
        paired_sides(shapes, individuals, sides[:5])
    with pytest.raises(InputError, match="samples"):
        paired_sides(np.where(shapes == shapes[0, 0, 0], np.nan, shapes), individuals, sides)
