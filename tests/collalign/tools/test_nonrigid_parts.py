"""Parts of non-rigid matching: curvature, orientation, masks, the graph operator, evidence, evaluation."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from collalign.nonrigid.functional_map import FunctionalMap
from collalign.nonrigid.map_evidence import measure_evidence
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.nonrigid.spectral_shape import (
    outward,
    prepare_surface,
    signed_volume,
    smoothed_curvature,
)
from collalign.tools.match import nonrigid as match_tool
from collalign.wording import note_text
from data_tools.datasets.synthetic_shapes import blob, figure
from data_tools.surface.laplacian import cotangent_laplacian

SMALL = SurfaceOptions(num_functions=40, num_samples=40, num_dense=300)


@pytest.fixture(scope="module")
def body():
    return prepare_surface(figure(), SMALL)


def identity_of(shape):
    own = np.arange(len(shape.dense))
    return FunctionalMap(
        C_source_target=np.eye(len(shape.eigenvalues) + 1),
        map_target_source=own,
        map_source_target=own,
    )


def test_curvature_is_positive_on_bumps_and_negative_in_dents(rng):
    shape = blob(rng)
    operators = cotangent_laplacian(shape.vertices, shape.faces)
    curvature = smoothed_curvature(shape, operators, time=3e-4)
    assert curvature.min() < 0.0 < curvature.max()
    inside_out = outward(replace(shape, faces=shape.faces[:, ::-1].copy()))
    assert signed_volume(inside_out) > 0
    assert smoothed_curvature(inside_out, operators, time=3e-4) == pytest.approx(curvature)


def test_evidence_of_the_identity_is_perfect_and_of_others_is_not(body, rng):
    identity = identity_of(body)
    perfect = measure_evidence(body, body, identity)
    assert perfect.curvature == pytest.approx(0.0, abs=1e-9)
    assert perfect.commutativity == pytest.approx(0.0, abs=1e-9)
    assert perfect.roughness == pytest.approx(0.0, abs=1e-9)
    assert perfect.orientation == pytest.approx(1.0)
    mixed = rng.permutation(len(body.dense))
    wrong = measure_evidence(body, body, replace(identity, map_target_source=mixed))
    assert wrong.curvature > 0.5
    assert wrong.roughness > 0.5
    assert wrong.score > perfect.score
    rotated = np.eye(41)
    rotated[1:3, 1:3] = [[0.0, 1.0], [-1.0, 0.0]]
    assert (
        measure_evidence(body, body, replace(identity, C_source_target=rotated)).commutativity
        > 0.001
    )


def candidate_at(places, images, score):
    """A candidate map of points whose images are these places."""
    forward = cKDTree(places).query(images)[1]
    return SimpleNamespace(
        functional_map=SimpleNamespace(map_target_source=forward),
        evidence=SimpleNamespace(orientation=0.6),
        score=score,
    )


def test_a_rival_that_is_a_half_turn_is_named_by_what_it_exchanges(rng):
    places = rng.standard_normal((200, 3)) * [1.0, 1.0, 4.0]
    places = np.concatenate([places, *(places * signs for signs in ((-1, -1, 1), (1, -1, -1)))])
    body = SimpleNamespace(
        name="ape", vertices=places, dense=np.arange(600), area=100.0, mass=np.full(600, 1 / 600)
    )
    own, about_long, upside_down, near = (
        candidate_at(places, places[:200] * signs, score)
        for signs, score in (
            ((1, 1, 1), -5.0),
            ((-1, -1, 1), -4.5),
            ((1, -1, -1), -4.8),
            ((1.001, 1, 1), -4.9),
        )
    )
    person = SimpleNamespace(name="person")
    (note,) = match_tool._half_turned(body, person, [own, about_long])
    assert note.code == "map-half-turned"
    assert note.shapes == ("person", "ape")
    assert note.values == {"exchanged": "front and back"}
    (note,) = match_tool._half_turned(body, person, [own, about_long, upside_down])
    assert note.values == {"exchanged": "the two ends"}
    assert match_tool._half_turned(body, person, [own, near]) == ()
    about_long.evidence.orientation = -0.6
    assert match_tool._half_turned(body, person, [own, about_long]) == ()


def test_a_note_says_what_share_has_no_counterpart_on_a_cut_surface():
    whole = SimpleNamespace(name="whole", to_working=np.arange(8))
    part = SimpleNamespace(name="part", to_working=np.array([0, 1, -1]))
    (note,) = match_tool._cut_notes((whole, part), [np.arange(8) > 5, np.zeros(3, dtype=bool)])
    assert (note.code, note.shapes, note.values) == (
        "no-counterpart",
        ("whole",),
        {"other": "part", "share": 0.25},
    )
    assert note_text(note).startswith("part is cut: 25% of the vertices of whole")
    (note,) = match_tool._cut_notes(
        (whole, part), [np.zeros(8, dtype=bool), np.array([True, False, False])]
    )
    assert note.values == {"other": "whole", "share": 0.5}, (
        "of the vertices that are matched at all"
    )
