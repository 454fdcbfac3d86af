"""Likeness of morphospaces, and the errors of templates."""

import numpy as np

from experiments.collections.templates import products, rv_coefficient


def test_other_shapes_are_told_from_noise():
    rng = np.random.default_rng(1)
    base, ways = rng.standard_normal((30, 3)), rng.standard_normal((2, 30, 3))
    scores = rng.standard_normal((8, 2))
    shapes = base + 0.1 * np.einsum("nw,wkd->nkd", scores, ways)
    noisy = shapes + 0.01 * rng.standard_normal(shapes.shape)
    others = base + 0.1 * np.einsum("nw,wkd->nkd", scores[::-1], ways)
    likeness = [rv_coefficient(products(shapes), products(other)) for other in (noisy, others)]
    assert likeness[0] > 0.95 > likeness[1] + 0.1
