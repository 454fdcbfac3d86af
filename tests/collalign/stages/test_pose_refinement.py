"""Which pairs are refined, and that refinement brings disturbed poses of equal shapes back."""

import itertools

import networkx as nx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions
from collalign.stages.poses.refinement import (
    MOST_WEIGHT,
    local_pairs,
    refine_pair,
    refine_rotations,
)
from collalign.whole_pairs.problem import dense_points
from data_tools.datasets.synthetic_shapes import crown, figure
from data_tools.embedding.embedding import sample_shape
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from pairwise.dense import DensePoints
from tests.finished_runs import angles_deg


def all_edges(num):
    return np.array(list(itertools.combinations(range(num), 2)))


def test_local_pairs_keep_the_nearest_and_the_connection(rng):
    edges = all_edges(12)
    energies = rng.random(len(edges))
    energies[np.isin(edges, range(6)).sum(axis=1) == 1] += 10.0  # two families, far from each other
    kept = local_pairs(12, edges, energies, num=2)
    assert nx.is_connected(nx.Graph(kept.tolist()))
    assert len(kept) < len(edges) / 2
    chosen = {tuple(pair) for pair in kept.tolist()}
    for shape in range(12):
        own = [e for e, pair in enumerate(edges) if shape in pair]
        nearest = min(own, key=lambda e: energies[e])
        assert tuple(edges[nearest]) in chosen
    across = [pair for pair in chosen if (pair[0] < 6) != (pair[1] < 6)]
    assert len(across) == 1


def posed_crowns(rng, num, *, num_points=16, num_dense=200):
    """Return one crown in several poses, mirrored ones among them."""
    shape = crown(num_vertices=500)
    turns = np.stack([random_rotation(rng, group="O") for _ in range(num)])
    options = SamplingOptions(num_points=num_points, num_dense_points=num_dense)
    samples = [
        sample_shape(
            Shape.from_arrays(shape.vertices @ turn, shape.faces),
            options,
            EmbeddingOptions(kind="xyz"),
        )
        for turn in turns
    ]
    return samples, turns


def errors_deg(rotations, truth):
    return angles_deg(rotations @ np.swapaxes(truth, 1, 2))


@pytest.fixture
def session():
    with Session.open(AlignOptions(), RunOptions(jobs=1)) as opened:
        yield opened


def test_disturbed_poses_come_back(session, rng):
    samples, truth = posed_crowns(rng, 4)
    disturbed = Rotation.from_rotvec(0.12 * rng.standard_normal((4, 3))).as_matrix() @ truth
    edges = all_edges(4)
    refined = refine_rotations(
        session, samples, disturbed, edges, np.ones(len(edges)), group="O", fixed={0: disturbed[0]}
    )
    assert errors_deg(disturbed, truth).max() > 5
    assert errors_deg(refined, truth).max() < 0.5
    assert np.allclose(refined[0], disturbed[0])


def bowed_figures(angles):
    """Return samples of one figure whose head and arms are bent forwards by angles, in radians, in one frame."""
    made = []
    for angle in angles:
        whole = figure(resolution=3)
        vertices = np.array(whole.vertices)
        above = vertices[:, 2] > 12.0
        bend = Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix()
        vertices[above] = (vertices[above] - [0.0, 1.0, 12.0]) @ bend.T + [0.0, 1.0, 12.0]
        options = SamplingOptions(num_points=16, num_dense_points=300)
        shape = Shape.from_arrays(vertices, whole.faces)
        made.append(sample_shape(shape, options, EmbeddingOptions(kind="xyz")))
    return made


def test_versions_of_one_surface_are_posed_by_what_they_share(session):
    truth, edges = np.tile(np.eye(3), (4, 1, 1)), all_edges(4)
    refined = refine_rotations(
        session,
        bowed_figures([0.0, 0.8, -0.8, 0.5]),
        truth,
        edges,
        np.ones(len(edges)),
        group="SO",
        fixed={0: np.eye(3)},
    )
    assert errors_deg(refined, truth).max() < 1


def test_a_pair_weighs_by_what_it_shares(rng):
    """No more than a hundred times as much as others, however exact; not more, where it shares nothing."""
    points = dense_points(bowed_figures([0.0])[0]).points
    one = DensePoints.from_user(points)
    top = points[:, 2] > np.quantile(points[:, 2], 0.9)
    moved = DensePoints.from_user(points + top[:, None] * [0.0, 0.2, 0.0])
    other = DensePoints.from_user(rng.standard_normal(points.shape))
    weights = [refine_pair(one, item, np.eye(3))[2] for item in (moved, other)]
    assert weights == pytest.approx([MOST_WEIGHT, 1.0])


def test_every_shape_names_its_nearest_pairs_beside_the_tree():
    edges = all_edges(5)
    energies = np.array([1.0, 1.1, 1.2, 1.3, 9.0, 8.0, 7.0, 6.0, 5.0, 9.5])  # a star about shape 0
    assert len(local_pairs(5, edges, energies, num=1)) == 4
    named = {tuple(pair) for pair in local_pairs(5, edges, energies, num=2).tolist()}
    assert named == {(0, 1), (0, 2), (0, 3), (0, 4), (1, 4), (2, 3), (2, 4)}
