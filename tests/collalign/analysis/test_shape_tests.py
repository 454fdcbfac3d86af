"""Tests of shape against other formulas: differences of models."""

import numpy as np
import pytest

from collalign.analysis.shape_tests import (
    Effects,
    compare_groups,
    compare_held,
    compare_slopes,
    procrustes_anova,
)
from data_tools.errors import InputError, OptionsError


def family(rng, num=30):
    return rng.standard_normal((num, 12)), np.repeat(["a", "b", "c"], num // 3).tolist()


def test_p_is_as_often_small_as_it_says_where_there_is_nothing():
    rng = np.random.default_rng(1)
    found = [compare_groups(*family(rng), permutations=99) for _ in range(60)]
    for at in (1, 2):
        p = np.array([one[at].p[0] for one in found])
        assert 0.3 < p.mean() < 0.7
        assert np.mean(p <= 0.05) < 0.15


def test_neither_order_nor_names_decide():
    rng = np.random.default_rng(2)
    shapes, labels = family(rng)
    order = rng.permutation(30)
    one, other = (
        compare_groups(shapes, labels),
        compare_groups(shapes[order], [labels[at] for at in order]),
    )
    np.testing.assert_allclose(one[1].p, other[1].p)
    np.testing.assert_allclose(one[2].z, other[2].z)
    sizes = rng.random((30, 1))
    rows = (
        procrustes_anova(shapes, {"size": sizes}),
        procrustes_anova(shapes[order], {"size": sizes[order]}),
    )
    assert np.isclose(rows[0][0].p, rows[1][0].p)


def test_p_counts_what_was_found_and_holm_is_no_smaller():
    found = Effects.of(np.array([[3.0, 1.0, 2.0], [1, 2, 2], [2, 3, 1], [1, 4, 1]]))
    np.testing.assert_allclose(found.p, [0.25, 1.0, 0.5])
    np.testing.assert_allclose(found.holm, [0.75, 1.0, 1.0])
    np.testing.assert_allclose(
        Effects(values=found.values, z=found.z, p=np.array([0.02, 0.5, 0.01])).holm,
        [0.04, 0.5, 0.03],
    )


def test_too_few_shapes_are_refused():
    rng = np.random.default_rng(3)
    with pytest.raises(InputError, match="3 columns"):
        procrustes_anova(rng.random((3, 4)), {"size": rng.random((3, 2))})
    for labels in (["a", "a", "a"], ["a", "a", "b"]):
        with pytest.raises(InputError, match="two groups"):
            compare_groups(rng.random((3, 4)), labels)


def unbalanced(rng, num=24):
    """Shapes, sizes, ages and groups of unequal counts that overlap."""
    sex = np.array(["f"] * 15 + ["m"] * (num - 15))
    size = rng.standard_normal(num) + (sex == "m")
    age = rng.standard_normal(num) + 0.5 * size
    shapes = (
        rng.standard_normal((num, 4))
        + np.outer(size, [1, 0, 0.5, 0])
        + np.outer(sex == "m", [0, 1, 0, 0])
    )
    return shapes, size, age, sex


def residual_squares(shapes, *columns):
    """Sum of squares that a linear model with constant leaves, by its normal equations."""
    design = np.column_stack([np.ones(len(shapes)), *columns])
    left = shapes - design @ np.linalg.solve(design.T @ design, design.T @ shapes)
    return float((left**2).sum())


def test_sums_of_squares_of_both_types_are_differences_of_models():
    shapes, size, age, sex = unbalanced(np.random.default_rng(4))
    male = (sex == "m").astype(float)
    terms = {"size": size[:, None], "sex": np.column_stack([1 - male, male]), "age": age[:, None]}
    terms["size:sex"] = size[:, None] * terms["sex"]
    columns = {"size": size, "sex": male, "age": age, "size:sex": size * male}
    models = {
        "I": {
            "size": [],
            "sex": ["size"],
            "age": ["size", "sex"],
            "size:sex": ["size", "sex", "age"],
        },
        "II": {"size": ["sex", "age"], "sex": ["size", "age"], "age": ["size", "sex", "size:sex"]},
    }
    models["II"]["size:sex"] = ["size", "sex", "age"]
    whole = residual_squares(shapes, *columns.values())
    for sums, before in models.items():
        rows = procrustes_anova(shapes, terms, sums=sums, permutations=99)
        for row in rows[:4]:
            others = [columns[name] for name in before[row.effect]]
            squares = residual_squares(shapes, *others) - residual_squares(
                shapes, *others, columns[row.effect]
            )
            assert row.df == 1
            np.testing.assert_allclose(row.sum_of_squares, squares, rtol=1e-9)
            np.testing.assert_allclose(row.f, squares / (whole / 19), rtol=1e-9)
        np.testing.assert_allclose(rows[4].sum_of_squares, whole, rtol=1e-9)
    with pytest.raises(OptionsError, match="sums"):
        procrustes_anova(shapes, terms, sums="III")


def test_with_size_held_constant_only_what_size_does_not_explain_is_left():
    rng = np.random.default_rng(6)
    size = np.concatenate([rng.normal(0, 1, 20), rng.normal(4, 1, 20)])
    labels = ["small"] * 20 + ["large"] * 20
    by_size = np.outer(size, [2.0, 1.0, 0.0]) + 0.3 * rng.standard_normal((40, 3))
    assert compare_groups(by_size, labels)[1].p[0] == 0.001
    assert compare_held(by_size, labels, size[:, None]).p[0] > 0.05
    moved = by_size + np.outer([label == "large" for label in labels], [0.0, 0.0, 2.0])
    held = compare_held(moved, labels, size[:, None], permutations=199)
    assert held.p[0] < 0.02
    assert np.isclose(200 * held.p[0] % 1, 0)
    design = np.column_stack([np.ones(40), [label == "large" for label in labels], size])
    expected = np.linalg.norm(np.linalg.solve(design.T @ design, design.T @ moved)[1])
    np.testing.assert_allclose(held.values[0], expected)
    with pytest.raises(InputError, match="apart"):
        compare_held(moved, labels, np.ones((40, 1)))


def test_slopes_differ_where_they_were_planted():
    rng = np.random.default_rng(7)
    size, labels = rng.standard_normal(45), np.repeat([*"abc"], 15).tolist()
    turned = np.array([label == "c" for label in labels])
    shapes = np.where(turned[:, None], np.outer(size, [0.0, 1.0]), np.outer(size, [1.0, 0.0]))
    differences, angles = compare_slopes(shapes + 0.2 * rng.standard_normal((45, 2)), labels, size)
    assert differences.p[[1, 2]].max() < 0.01 < differences.p[0]
    np.testing.assert_allclose(angles, [0, 90, 90], atol=15)
    np.testing.assert_allclose(differences.values[1:], np.sqrt(2), atol=0.3)
