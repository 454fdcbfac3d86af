"""Classification of labelled shapes, and the distances of surfaces that it goes by: what theory says of any."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.analysis.label_table import read_labels
from collalign.analysis.procrustes import procrustes_distances, unit_size
from collalign.tools.variation.classification import (
    classify_leave_one_out,
    distances_at_poses,
    surface_distances,
)
from data_tools.datasets.synthetic import bumped
from data_tools.datasets.synthetic_shapes import crown, figure
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from tests.optional import optional_module

LINE = np.array([0.0, 1.0, 10.0, 11.0, 30.0, 12.5])
DISTANCES = np.abs(LINE[:, None] - LINE[None, :])


def test_accuracy_is_that_of_scikit_learn(rng):
    sklearn = optional_module("sklearn.neighbors")
    selection = optional_module("sklearn.model_selection")
    points = rng.standard_normal((40, 3))
    kinds = np.array(["abc"[at % 3] for at in range(40)])
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = selection.cross_val_score(
        sklearn.KNeighborsClassifier(1), points, kinds, cv=selection.LeaveOneOut()
    ).mean()
    assert classify_leave_one_out(distances, kinds.tolist()).accuracy == pytest.approx(expected)


def test_single_members_are_not_scored_but_remain_neighbours():
    found = classify_leave_one_out(DISTANCES, ["a", "a", "b", "c", "d", "b"])
    assert found.single_members == ("c", "d")
    assert (found.num_scored, found.num_correct) == (4, 2)
    assert found.by_label == {"a": (2, 2), "b": (2, 0), "c": (0, 0), "d": (0, 0)}
    assert "2 shapes that are the only member" in found.statement
    assert "not scored" in found.statement


def test_unknown_labels_are_neither_scored_nor_neighbours():
    found = classify_leave_one_out(DISTANCES, ["a", "a", "b", "NA", "", "b"])
    assert found.nearest.tolist() == [1, 0, 5, -1, -1, 2]
    assert found.accuracy == 1
    assert found.chance == pytest.approx(1 / 3)


def test_shapes_without_any_distance_are_errors():
    distances = DISTANCES.copy()
    distances[0, :] = distances[:, 0] = np.nan
    found = classify_leave_one_out(distances, ["a", "a", "b", "b", "b", "b"], names=list("uvwxyz"))
    assert found.nearest[0] == -1
    assert found.num_correct == 4
    record = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert record["wrong"][0]["shape"] == "u"
    assert record["wrong"][0]["predicted"] is None
    assert record["accuracy"] == pytest.approx(4 / 6)
    assert "4 of 6" in found.table()
    assert found.table().splitlines()[1].split() == ["a", *map(str, found.by_label["a"])]


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="expected shape"):
        classify_leave_one_out(DISTANCES, ["a"])
    with pytest.raises(InputError, match="at least two"):
        classify_leave_one_out(DISTANCES, ["a", "", "", "", "", ""])


def cloud(shape):
    chosen = farthest_points(shape, 150, metric="euclidean")
    return unit_size(shape.vertices[None, chosen])[0]


@pytest.fixture(scope="module")
def clouds():
    rng = np.random.default_rng(0)
    tooth, body = crown(rng, num_vertices=400), figure()
    return [
        cloud(s) for s in (tooth, bumped(tooth, rng, rms=0.01), body, bumped(body, rng, rms=0.01))
    ]


def test_refining_takes_back_a_turn_that_the_poses_left(clouds):
    turn = Rotation.from_euler("z", 0.1).as_matrix()
    turned = [clouds[0], 1.7 * clouds[0] @ turn.T]
    groups = np.zeros(2, dtype=np.int64)
    assert distances_at_poses(turned)[0, 1] > 0.01
    assert surface_distances(turned, groups)[0, 1] < 1e-3


@pytest.mark.data
def test_expert_landmarks_of_teeth_classify_as_published(shared_data):
    """Boyer et al., PNAS 108 (2011), table 1: 94.3 % of 106 teeth by family, 95.7 % of 116 by order."""
    folder = shared_data / "teeth_pnas116"
    data = np.load(folder / "landmarks_mesh_coords.npz")
    names, landmarks = data["names"].tolist(), data["landmarks"][:, :16]
    labels = read_labels(folder / "labels.csv")
    sides = np.array(labels.column("chirality_from_landmarks", names), dtype=float)
    landmarks = (
        landmarks * np.stack([sides, np.ones(len(sides)), np.ones(len(sides))], axis=1)[:, None]
    )
    distances = procrustes_distances(landmarks)
    for by, scored, correct in (("family", 106, 100), ("order", 116, 111)):
        found = classify_leave_one_out(distances, labels.column(by, names))
        assert (found.num_scored, found.num_correct) == (scored, correct)
