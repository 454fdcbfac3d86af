"""Poses from pairs: exactness, gauge, invariances, candidates, constraints, and what is refused."""

import networkx
import numpy as np
import pytest

from collalign.synchronization import PairGraph, synchronize, synchronize_graph
from collalign.synchronization.frames import angles_rad
from collalign.synchronization.model import EdgeModel
from data_tools.errors import InputError, OptionsError
from pairwise.rotation_pattern import RotationPattern
from tests.notes import codes
from tests.synchronization_problems import (
    D2_FLIPS,
    complete_edges,
    exact_pairs,
    flipped_pairs,
    pose_errors_deg,
    random_rotations,
    regular_edges,
)

METHODS = ["robust", "spectral"]


GRAPHS = {
    "pair": networkx.path_graph(2),
    "path": networkx.path_graph(40),
    "cycle": networkx.cycle_graph(15),
    "star": networkx.star_graph(12),
    "grid": networkx.convert_node_labels_to_integers(networkx.grid_2d_graph(4, 5)),
    "complete": networkx.complete_graph(12),
    "barbell": networkx.barbell_graph(6, 3),
    "regular": networkx.random_regular_graph(4, 30, seed=1),
    "large path": networkx.path_graph(450),
    "large regular": networkx.random_regular_graph(4, 450, seed=2),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", GRAPHS)
def test_exact_pairs_are_recovered_on_every_connected_graph(name, method):
    graph = GRAPHS[name]
    edges = np.array(sorted(tuple(sorted(e)) for e in graph.edges))
    pairs = exact_pairs(random_rotations(np.random.default_rng(3), len(graph)), edges)
    found = synchronize(edges, pairs, method=method)
    assert np.abs(exact_pairs(found.rotations, edges) - pairs).max() < 1e-8
    assert found.edge_inlier.all()
    assert np.allclose(found.rotations[0], np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("dim", "group"), [(2, "SO"), (2, "O"), (3, "O"), (5, "SO"), (5, "O")])
@pytest.mark.parametrize("method", METHODS)
def test_other_groups_are_recovered(dim, group, method):
    rng = np.random.default_rng(dim)
    edges = regular_edges(14, 5, 0)
    truth = random_rotations(rng, 14, dim, group=group)
    found = synchronize(edges, exact_pairs(truth, edges), group=group, method=method)
    assert np.abs(exact_pairs(found.rotations, edges) - exact_pairs(truth, edges)).max() < 1e-8
    assert np.array_equal(
        np.linalg.det(found.rotations) < 0, np.linalg.det(truth) * np.linalg.det(truth[0]) < 0
    )


@pytest.mark.parametrize("method", METHODS)
def test_mixed_blocks_are_synchronized_apart(method):
    rng = np.random.default_rng(0)
    edges = regular_edges(16, 6, 0)
    truth = np.zeros((16, 7, 7))
    truth[:, :3, :3] = random_rotations(rng, 16)
    truth[:, 3:, 3:] = random_rotations(rng, 16, 4, group="O")
    pairs = exact_pairs(truth, edges)
    wrong = rng.choice(len(edges), 8, replace=False)
    pairs[wrong, 3:, 3:] = random_rotations(rng, 8, 4, group="O")
    found = synchronize(edges, pairs, rotation_pattern=(3, 4), method=method)
    assert np.abs(found.rotations[:, :3, 3:]).max() == 0.0
    assert np.linalg.det(found.rotations[:, :3, :3]).min() > 0
    clean = exact_pairs(truth, edges)
    assert np.abs(exact_pairs(found.rotations, edges) - clean)[:, :3, :3].max() < 1e-8
    if method == "robust":
        assert np.abs(exact_pairs(found.rotations, edges) - clean).max() < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_gauge_of_the_shapes_and_order_change_nothing(seed):
    rng = np.random.default_rng(seed)
    problem = flipped_pairs(rng, regular_edges(14, 6, 1), 14, wrong=0.1, num_candidates=4)
    first = synchronize(problem.edges, problem.rotations, energies=problem.energies)
    turns = random_rotations(rng, 14)
    order = rng.permutation(14)
    left, right = turns[problem.edges[:, 0]], turns[problem.edges[:, 1]]
    turned = np.swapaxes(left, 1, 2)[:, None] @ problem.rotations @ right[:, None]
    moved = synchronize(order[problem.edges], turned, energies=problem.energies)
    expected = first.rotations @ turns
    relative_pairs = exact_pairs(expected, problem.edges)
    assert np.allclose(
        exact_pairs(moved.rotations[order], problem.edges), relative_pairs, atol=1e-3
    )
    assert np.array_equal(first.edge_choice, moved.edge_choice)
    assert np.allclose(first.confidence, moved.confidence[order], atol=0.05)


def test_outliers_do_not_move_the_answer():
    problem = flipped_pairs(
        np.random.default_rng(8), complete_edges(40), 40, wrong=0.5, kind="uniform"
    )
    robust = synchronize(problem.edges, problem.rotations)
    spectral = synchronize(problem.edges, problem.rotations, method="spectral")
    robust_deg = pose_errors_deg(robust.rotations, problem.truth)
    spectral_deg = pose_errors_deg(spectral.rotations, problem.truth)
    assert np.median(robust_deg) < 0.5 * np.median(spectral_deg)
    assert robust_deg.max() < 8.0
    wrong = np.rad2deg(angles_rad(_misfit(problem))) > 60.0
    assert (robust.edge_inlier != wrong).mean() > 0.95


def _misfit(problem):
    return np.swapaxes(problem.rotations[:, 0], 1, 2) @ exact_pairs(problem.truth, problem.edges)


def test_candidates_are_chosen_by_consistency_and_energy():
    edges = regular_edges(40, 10, 0)
    problem = flipped_pairs(np.random.default_rng(9), edges, 40, wrong=0.3, num_candidates=4)
    found = synchronize(edges, problem.rotations, energies=problem.energies)
    assert pose_errors_deg(found.rotations, problem.truth).max() < 20.0
    chosen = problem.rotations[np.arange(len(edges)), found.edge_choice]
    apart = angles_rad(np.swapaxes(chosen, 1, 2) @ exact_pairs(problem.truth, edges))
    assert np.rad2deg(apart).max() < 60.0
    assert (found.edge_choice != np.argmin(problem.energies, axis=1)).mean() > 0.2


def test_fixed_shapes_come_out_exactly_and_turn_the_others_with_them():
    edges = regular_edges(24, 6, 0)
    problem = flipped_pairs(np.random.default_rng(11), edges, 24, wrong=0.1, num_candidates=4)
    free = synchronize(edges, problem.rotations, energies=problem.energies)
    turn = random_rotations(np.random.default_rng(1), 1)[0]
    wanted = {i: turn @ free.rotations[i] for i in (2, 7, 9)} | {
        5: turn @ free.rotations[5] @ D2_FLIPS[1]
    }
    found = synchronize(edges, problem.rotations, energies=problem.energies, fixed=wanted)
    assert all(np.array_equal(found.rotations[i], pose) for i, pose in wanted.items())
    others = np.setdiff1d(np.arange(24), list(wanted))
    moved = np.swapaxes(turn @ free.rotations[others], 1, 2) @ found.rotations[others]
    assert np.rad2deg(angles_rad(moved)).max() < 20.0
    assert found.confidence[2] == found.confidence[5] == 1.0
    assert len(found.edge_choice) == len(edges)


def test_fixed_pairs_are_certain_of_what_they_state_whatever_their_log_odds_said():
    edges = complete_edges(5)
    problem = flipped_pairs(np.random.default_rng(14), edges, 5, wrong=0.2, num_candidates=4)
    odds = [
        np.array([-np.inf, 1.0, 0.0, -2.0]) for _ in edges
    ]  # maps may exclude a pose altogether
    graph = PairGraph.of_candidates(
        edges,
        list(zip(problem.rotations, problem.energies, strict=True)),
        num_shapes=5,
        pattern=RotationPattern.from_user(None, 3, "SO"),
        log_odds=odds,
    )
    wanted = dict(enumerate(random_rotations(np.random.default_rng(2), 3)))
    full = graph.with_constraints(wanted)
    assert np.array_equal(full.best_choice[full.fixed], np.zeros(2))
    assert np.array_equal(
        np.exp(EdgeModel(graph=full).log_prior[full.fixed]), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    )
    found = synchronize_graph(graph, fixed=wanted)
    assert all(np.array_equal(found.rotations[i], pose) for i, pose in wanted.items())


def test_the_choice_between_fixed_shapes_is_the_candidate_next_to_their_poses():
    truth = random_rotations(np.random.default_rng(3), 3)
    edges = complete_edges(3)
    right = exact_pairs(truth, edges)
    candidates = np.stack([right @ D2_FLIPS[1], right], axis=1)
    energies = np.tile([1.0, 1.1], (3, 1))
    found = synchronize(edges, candidates, energies=energies, fixed={0: truth[0], 1: truth[1]})
    assert found.edge_choice[0] == 1
    swapped = synchronize(
        edges, candidates[:, ::-1], energies=energies, fixed={0: truth[0], 1: truth[1]}
    )
    assert swapped.edge_choice[0] == 0


def test_disconnected_graphs_are_groups():
    truth = random_rotations(np.random.default_rng(13), 7)
    edges = np.array([[0, 1], [1, 2], [3, 4]])
    found = synchronize(edges, exact_pairs(truth, edges), num_shapes=7)
    assert [part.tolist() for part in found.components] == [[0, 1, 2], [3, 4], [5], [6]]
    assert codes(found.warnings) == ["unconnected"]
    assert np.isnan(found.confidence[5:]).all()
    assert np.allclose(found.rotations[3], np.eye(3), atol=1e-12)
    assert len(synchronize([], np.empty((0, 3, 3)), num_shapes=2).components) == 2


def test_bad_input_is_refused():
    eye = np.tile(np.eye(3), (2, 1, 1))
    edges = [[0, 1], [1, 2]]
    bad = [
        ({"edges": [[0, 1], [2, 2]]}, InputError, "itself"),
        ({"edges": [[0, 1], [1, 0]]}, InputError, "more than once"),
        ({"edges": [[0, 1], [1, -2]]}, InputError, "indices"),
        ({"num_shapes": 2}, InputError, "indices"),
        ({"edges": [[0.0, 1.0], [1.0, 2.0]]}, InputError, "integer"),
        ({"rotations": eye[:1]}, InputError, "rotations"),
        ({"rotations": eye * np.nan}, InputError, "NaN"),
        ({"rotations": 2 * eye}, InputError, "orthogonal"),
        ({"rotations": -eye}, InputError, "reflection"),
        ({"energies": [1.0, np.nan]}, InputError, "energies"),
        ({"energies": [1.0, np.inf]}, InputError, "no candidate"),
        ({"energies": [[1.0, 2.0], [1.0, 2.0]]}, InputError, "energies"),
        ({"weights": [1.0, -1.0]}, InputError, "negative"),
        ({"weights": [0.0, 0.0]}, InputError, "zero"),
        ({"group": "SE"}, OptionsError, "group"),
        ({"method": "tree"}, OptionsError, "method"),
        ({"fixed": {7: np.eye(3)}}, InputError, "fixed"),
        ({"fixed": {0: -np.eye(3)}}, InputError, "reflection"),
        ({"reference": 3}, InputError, "reference"),
        ({"rotation_pattern": (2, 2)}, OptionsError, "rotation_pattern"),
    ]
    synchronize(edges, eye)
    for change, error, words in bad:
        arguments = {"edges": edges, "rotations": eye, **change}
        with pytest.raises(error, match=words):
            synchronize(**arguments)


def test_pose_errors_see_a_wrong_pose():
    truth = random_rotations(np.random.default_rng(16), 9)
    turn = random_rotations(np.random.default_rng(17), 1)[0]
    assert pose_errors_deg(turn @ truth, truth).max() < 1e-5
    broken = turn @ truth
    broken[3] = broken[3] @ D2_FLIPS[2]
    errors = pose_errors_deg(broken, truth)
    assert errors[3] > 170.0
    assert np.delete(errors, 3).max() < 1e-5
