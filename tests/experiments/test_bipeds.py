"""Generated bodies: closed, each of its own mesh, with a true map, bent as animals bend."""

import numpy as np
import pytest

from data_tools.surface.topology import is_open_surface, mesh_components
from experiments.generated.bipeds import KINDS, KINDS_APART, biped, template_points
from experiments.maps.evaluation import MapEvaluator
from experiments.maps.map_sets import BIPEDS, BIPEDS_APART, read_map_set


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


def test_knees_bend_backwards_and_elbows_forwards(rng):
    points = template_points()

    def at(body, *places):
        found = [int(np.linalg.norm(points - place, axis=1).argmin()) for place in places]
        return body.shape.vertices[body.places[found]]

    for _ in range(5):
        body = biped(KINDS["person"], rng)
        toe, heel, shin, calf = at(
            body, (0.2, 0.12, 0.03), (-0.08, 0.12, 0.04), (0.05, 0.12, 0.35), (-0.08, 0.12, 0.35)
        )
        assert (toe - heel) @ (shin - calf) > 0
        hip, knee, ankle = at(body, (0, 0.18, 0.8), (0, 0.18, 0.5), (0, 0.17, 0.1))
        bend = 0.5 * (hip + ankle) - knee
        assert bend @ (shin - calf) < 0.02


def test_sets_of_pairs_are_of_two_kinds_with_landmarks_and_their_mirror_images(tmp_path):
    for name in (BIPEDS, BIPEDS_APART):
        maps = read_map_set(tmp_path, name)
        assert all(a.split()[0] != b.split()[0] for a, b in maps.pairs)
        marks = maps.landmarks(maps.pairs[0][0])
        mirror = maps.data.mirror
        assert (mirror[mirror] == np.arange(len(marks))).all()
        shape = maps.data.shape(maps.pairs[0][0])
        assert marks.max() < len(shape.vertices)
        assert (shape.vertices[marks] != shape.vertices[marks[mirror]]).any(axis=1).mean() > 0.9
    assert {name.split()[0] for name in maps.data.names} == {"person", *KINDS_APART}
