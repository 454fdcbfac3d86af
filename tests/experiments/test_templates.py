"""Likeness of morphospaces, and the errors of templates."""

import numpy as np

from experiments.collections.templates import of_others, products, row_of, rv_coefficient


def test_other_shapes_are_told_from_noise():
    rng = np.random.default_rng(1)
    base, ways = rng.standard_normal((30, 3)), rng.standard_normal((2, 30, 3))
    scores = rng.standard_normal((8, 2))
    shapes = base + 0.1 * np.einsum("nw,wkd->nkd", scores, ways)
    noisy = shapes + 0.01 * rng.standard_normal(shapes.shape)
    others = base + 0.1 * np.einsum("nw,wkd->nkd", scores[::-1], ways)
    likeness = [rv_coefficient(products(shapes), products(other)) for other in (noisy, others)]
    assert likeness[0] > 0.95 > likeness[1] + 0.1


def test_a_template_is_not_judged_on_itself():
    errors = np.array([[[0.0], [2.0], [4.0]], [[1.0], [0.0], [np.nan]], [[3.0], [5.0], [0.0]]])
    np.testing.assert_allclose(of_others(errors), [3.0, 1.0, 4.0])
    rng = np.random.default_rng(2)
    shapes = rng.standard_normal((30, 3)) + 0.1 * rng.standard_normal((3, 30, 3))
    gram, other = products(shapes), products(shapes[[0, 2, 1]])
    record = {
        "products": [gram, gram, other],
        "landmarks": gram,
        "errors": errors,
        "dropped": 1,
        "processor_s": 2.0,
    }
    row = row_of(record)
    assert np.isclose(row["rv"], (1 + 2 * rv_coefficient(gram, other)) / 3)
    assert np.isclose(row["worst_rv"], rv_coefficient(gram, other))
    assert (row["templates"], row["worst_error"], row["dropped"]) == (3, 4.0, 1)
