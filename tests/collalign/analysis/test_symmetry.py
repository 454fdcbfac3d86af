"""Symmetric and asymmetric components come back from shapes that were made of known ones."""

import numpy as np
import pytest

from collalign.analysis.symmetry import mirror_image, mirror_normal, object_symmetry
from data_tools.errors import InputError
from data_tools.rotations import random_rotation

#: Ten pairs and four points on the midline.
PARTNER = np.array([*range(10, 20), *range(10), 20, 21, 22, 23])


def symmetric(points, partner=PARTNER):
    return 0.5 * (points + mirror_image(points, partner))


def family(rng, *, num=12, directional=0.0, fluctuating=0.01):
    """Return asymmetric variants of one symmetric shape in random poses and sizes, shape (num, 24, 3)."""
    base = symmetric(
        rng.standard_normal((24, 3)) + [2.0, 0, 0] * np.repeat([1, -1, 0], [10, 10, 4])[:, None]
    )
    base /= np.linalg.norm(base)
    one_sided = rng.standard_normal((24, 3))
    one_sided -= symmetric(one_sided)
    shapes = []
    for _ in range(num):
        noise = rng.standard_normal((24, 3))
        shape = base + 0.05 * symmetric(rng.standard_normal((24, 3)))
        shape = shape + directional * one_sided + fluctuating * (noise - symmetric(noise))
        shapes.append(rng.uniform(0.5, 3) * shape @ random_rotation(rng).T + rng.random(3))
    return np.array(shapes)


def row(found, effect):
    return next(one.sum_of_squares for one in found.anova if one.effect == effect)


def test_components_are_symmetric_antisymmetric_orthogonal_and_whole():
    shapes = family(np.random.default_rng(0), directional=0.02)
    found = object_symmetry(shapes, PARTNER)
    np.testing.assert_allclose(mirror_image(found.symmetric, PARTNER), found.symmetric, atol=1e-12)
    np.testing.assert_allclose(
        mirror_image(found.asymmetric, PARTNER), -found.asymmetric, atol=1e-12
    )
    assert np.abs((found.symmetric * found.asymmetric).sum(axis=(1, 2))).max() < 1e-12
    whole = found.symmetric + found.asymmetric
    np.testing.assert_allclose(np.linalg.norm(whole, axis=(1, 2)), 1)
    np.testing.assert_allclose(mirror_image(found.mean, PARTNER), found.mean, atol=1e-12)


def test_symmetric_shapes_have_no_asymmetry():
    found = object_symmetry(family(np.random.default_rng(1), fluctuating=0.0), PARTNER)
    assert found.asymmetry.max() < 1e-6
    assert row(found, "individual") > 0


def test_replicates_tell_fluctuating_asymmetry_from_measurement_error():
    rng = np.random.default_rng(5)
    shapes = family(rng, num=8, fluctuating=0.02)
    sizes = np.linalg.norm(shapes - shapes.mean(axis=1, keepdims=True), axis=(1, 2))
    again = np.repeat(shapes, 2, axis=0) + 0.001 * np.repeat(sizes, 2)[
        :, None, None
    ] * rng.standard_normal((16, 24, 3))
    individuals = [f"s{at // 2}" for at in range(16)]
    assert object_symmetry(again, PARTNER, individuals=individuals).anova[2].f > 50
    scrambled = [individuals[at] for at in rng.permutation(16)]
    assert object_symmetry(again, PARTNER, individuals=scrambled).anova[2].f < 5


def test_shapes_of_unknown_individuals_are_not_taken_for_one():
    shapes = family(np.random.default_rng(14), num=10, directional=0.02)
    owners = ["a", "a", "b", "b", "c", "c", "d", "d"]
    found = object_symmetry(shapes, PARTNER, individuals=[*owners, "", ""])
    rows = {one.effect: one for one in found.anova}
    assert rows["individual"].plain_df == 3
    assert rows["residual"].plain_df == 2 * (8 - 4)
    assert len(found.asymmetry) == 10
    # the sums are of those eight alone, as they lie
    whole = (found.symmetric + found.asymmetric)[:8]
    both = np.concatenate([whole, mirror_image(whole, PARTNER)])
    total = ((both - both.mean(axis=0)) ** 2).sum()
    np.testing.assert_allclose(rows["total"].sum_of_squares, total)
    with pytest.raises(InputError, match="nobody is named"):
        object_symmetry(shapes, PARTNER, individuals=[""] * 10)


@pytest.mark.parametrize("repeats", [1, 2])
def test_neither_names_nor_order_decide_about_sides(repeats):
    shapes = family(np.random.default_rng(15), num=12, directional=0.002)
    owners = [f"s{at // repeats}" for at in range(12)]
    rng = np.random.default_rng(16)
    names = dict(zip(dict.fromkeys(owners), rng.permutation(len({*owners})), strict=True))
    order = rng.permutation(12)
    first = object_symmetry(shapes, PARTNER, individuals=owners, permutations=199)
    for again in (
        object_symmetry(
            shapes, PARTNER, individuals=[f"x{names[one]:03d}" for one in owners], permutations=199
        ),
        object_symmetry(
            shapes[order], PARTNER, individuals=[owners[at] for at in order], permutations=199
        ),
    ):
        for one, other in zip(first.anova, again.anova, strict=True):
            np.testing.assert_allclose([one.p, one.z], [other.p, other.z], rtol=1e-6)
    side = next(one for one in first.anova if one.effect == "side")
    assert 0.01 < side.p < 1.0, "else all draws would agree"


def test_wrong_pairs_are_no_answer():
    """Pairs that are exchanged show as asymmetry that is not there, or as no mirror image at all."""
    shapes = family(np.random.default_rng(7), fluctuating=0.0)
    wrong = PARTNER.copy()
    wrong[[0, 1, 10, 11]] = [11, 10, 1, 0]
    assert object_symmetry(shapes, wrong).asymmetry.min() > 0.05
    points = shapes[0] - shapes[0].mean(axis=0)
    normal = mirror_normal(points, PARTNER)
    reflected = points - 2 * np.outer(points @ normal, normal)
    np.testing.assert_allclose(reflected[PARTNER], points, atol=1e-9)
    inverted = np.array(
        [[1.0, 2, 3], [-1, -2, -3], [4, -1, 2], [-4, 1, -2], [0, 3, -1], [0, -3, 1]]
    )
    with pytest.raises(InputError, match="left and right"):
        mirror_normal(inverted, np.array([1, 0, 3, 2, 5, 4]))
    for bad in (PARTNER[:-1], PARTNER + 1, np.roll(PARTNER, 1), PARTNER.astype(float)):
        with pytest.raises(InputError, match="partner"):
            object_symmetry(shapes, bad)
    with pytest.raises(InputError, match="at least two"):
        object_symmetry(shapes[:1], PARTNER)
    with pytest.raises(InputError, match="individuals"):
        object_symmetry(shapes, PARTNER, individuals=["a"])
