"""Generated bodies: closed, each of its own mesh, with a true map, bent as animals bend."""

import numpy as np
import pytest

from data_tools.surface.topology import is_open_surface, mesh_components
from experiments.generated.bipeds import KINDS, KINDS_APART, biped
from experiments.maps.evaluation import MapEvaluator


@pytest.mark.parametrize("kind", [*KINDS, *KINDS_APART])
def test_bodies_are_one_closed_surface_and_no_two_share_their_vertices(kind, rng):
    first, second = (biped({**KINDS, **KINDS_APART}[kind], rng) for _ in range(2))
    for body in (first, second):
        assert mesh_components(len(body.shape.vertices), body.shape.faces)[0] == 1
        assert not is_open_surface(body.shape.vertices, body.shape.faces)
        a, b, c = (body.shape.vertices[body.shape.faces[:, i]] for i in range(3))
        assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    assert first.shape.faces.shape == second.shape.faces.shape
    assert (first.shape.faces != second.shape.faces).any()


def test_the_true_map_is_right_and_a_half_turned_one_is_not(rng):
    to, of = biped(KINDS["person"], rng), biped(KINDS["ape"], rng)
    points = np.arange(0, len(of.shape.vertices), 40)
    truth = to.true_map_from(of)
    evaluator = MapEvaluator(to.shape, truth[points])
    assert evaluator.errors(truth[points]).direct.max() == 0.0
    back = of.true_map_from(to)[truth[points]]
    returned = MapEvaluator(of.shape, points).errors(back).direct
    assert returned.mean() < 0.03
    assert evaluator.errors(rng.permutation(truth[points])).direct.mean() > 0.3
