"""Surfaces turn one way, their mirror images the other, and bilateral bodies neither in any posture."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.datasets.synthetic import bent, bumped, mirrored, shuffled
from data_tools.datasets.synthetic_shapes import blob, figure, sphere_mesh
from data_tools.embedding.chirality import chirality_scores, place_shares, surface_chirality
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape


def scores_of(*shapes):
    return chirality_scores([surface_chirality(shape) for shape in shapes])


@pytest.fixture(scope="module")
def blobs():
    """Two specimens of one kind."""
    base = blob(np.random.default_rng(4), num_vertices=800)
    return [bumped(base, np.random.default_rng(seed), rms=0.01) for seed in (1, 2)]


def test_poses_sizes_orders_and_inverted_triangles_change_nothing(blobs, rng):
    one, other = blobs
    usual = scores_of(one, other)[0, 1]
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = 7.0 * random_rotation(rng), 3.0
    moved = shuffled(other, rng)[0].transformed(transform)
    assert scores_of(one, moved)[0, 1] == pytest.approx(usual, rel=1e-6)
    inside_out = replace(other, faces=other.faces[:, ::-1].copy())
    assert scores_of(one, inside_out)[0, 1] == pytest.approx(usual, rel=1e-6)


def test_bilateral_bodies_turn_neither_way_in_any_posture(blobs, rng):
    body = figure(resolution=2)
    postures = [bumped(bent(body, rng, angle=0.5), rng, rms=0.002) for _ in range(3)]
    scores = scores_of(*postures)
    assert np.nanmax(np.abs(scores)) < 0.2 * scores_of(*blobs)[0, 1]


def test_one_place_tells_the_side_of_a_bilateral_body_with_a_bump(blobs):
    ball, faces = sphere_mesh(600)
    corners = np.array([(1, 1, 1), (1, -1, 1), (1, 1, -1), (1, -1, -1), (-1, -1, 1)])
    injured = []
    for seed, corner in enumerate(corners):
        bump = 0.35 * np.exp(-((ball - corner * [0.55, 0.55, 0.6]) ** 2).sum(axis=1) / 0.125)
        shape = Shape.from_arrays(ball * (1.0 + bump)[:, None] * [1.0, 0.8, 0.62], faces)
        noisy = bumped(shape, np.random.default_rng(seed), rms=0.005)
        injured.append(surface_chirality(noisy))
    sides = corners.prod(axis=1) < 0
    assert place_shares(injured, sides).min() > 0.5
    one, other = blobs
    measured = [surface_chirality(shape) for shape in (mirrored(one), one, other)]
    assert place_shares(measured, np.array([True, False, False])).max() < 0.4
    cloud = surface_chirality(Shape.from_arrays(ball))
    shares = place_shares([cloud, *injured], np.append(False, sides))
    np.testing.assert_allclose(shares, [np.nan, *place_shares(injured, sides)])
    assert np.isnan(place_shares([cloud, injured[0]], np.zeros(2, dtype=bool))).all()


def test_what_has_no_outer_side_is_unknown(blobs, rng):
    one, other = blobs
    cloud = Shape.from_arrays(other.vertices)
    soup = replace(
        other,
        faces=np.where(rng.random((len(other.faces), 1)) < 0.5, other.faces, other.faces[:, ::-1]),
    )
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), axis=-1).reshape(-1, 2)
    corners = np.arange(80)[np.arange(80) % 9 < 8][:64]
    faces = np.concatenate(
        [
            np.stack([corners, corners + 1, corners + 9], 1),
            np.stack([corners + 1, corners + 10, corners + 9], 1),
        ]
    )
    sheet = Shape.from_arrays(np.column_stack([grid, 0.1 * rng.standard_normal(81)]), faces)
    scores = scores_of(one, cloud, other, soup, sheet)
    known = np.isfinite(scores)
    assert known[0].tolist() == [False, False, True, False, False]
    assert known.sum() == 2
    assert np.isnan(scores_of(one, cloud)).all()


def test_a_surface_of_large_triangles_is_too_coarse_to_turn(rng):
    assert len(surface_chirality(blob(rng, num_vertices=200)).faces)
    assert not len(surface_chirality(blob(rng, num_vertices=16)).faces)
