"""Scans of one complete shape, their model: each is placed on it."""

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions, align_collection
from data_tools.datasets.synthetic import range_view
from data_tools.options import SamplingOptions
from data_tools.poses import scales_of
from data_tools.rotations import random_rotation
from experiments.generated.part_scans import is_right, model_of, part_scans
from tests.notes import codes
from tests.shafts import stepped_shaft

OPTIONS = AlignOptions(group="SO", sampling=SamplingOptions(num_points=24, num_dense_points=100))
NUM = 5


@pytest.fixture(scope="module")
def animal():
    """A closed mesh, and scans of parts of it with stray points."""
    model = model_of("animals", 3)
    return model, part_scans(model, NUM, np.random.default_rng(0))


@pytest.fixture(scope="module")
def aligned(tmp_path_factory):
    """Aligns a model and scans; all runs place the same scans once."""
    run = RunOptions(jobs=1, store=tmp_path_factory.mktemp("store") / "store.sqlite")

    def align(model, clouds, **keywords):
        shapes = {"model": model} | {f"scan{n}": points for n, points in enumerate(clouds)}
        return align_collection(shapes, options=OPTIONS, run=run, progress=False, **keywords)

    return align


@pytest.fixture(scope="module")
def by_default(animal, aligned):
    model, scans = animal
    return aligned((model.vertices, model.faces), [scan.points for scan in scans])


def on_the_model(collection):
    """The pose of each scan on the model."""
    return np.linalg.inv(collection.transforms[0]) @ collection.transforms[1:]


def test_scans_are_placed_on_the_model_by_default(by_default, animal):
    model, scans = animal
    poses = on_the_model(by_default)
    np.testing.assert_allclose(scales_of(poses), 1.0)
    right = [is_right(model, pose, scan.pose) for pose, scan in zip(poses, scans, strict=True)]
    assert sum(right) >= NUM - 1
    assert all(np.array(right)[by_default.confidence[1:] >= 0.95])
    assert (by_default.confidence[1:] >= 0.9).sum() >= NUM - 2
    assert not is_right(model, poses[0], scans[1].pose)


def test_only_the_scans_are_incomplete(by_default):
    assert [one.shape for one in by_default.incomplete] == [*range(1, NUM + 1)]
    for one in by_default.incomplete:
        assert one.partners.tolist() == [0]
        assert 0.05 < one.coverage < 0.5
        assert one.overlaps[0, 1] > one.overlaps[0, 0]
    assert "incomplete" in codes(by_default.notes)
    assert {*by_default.part_numbers.tolist()} == {0}
    assert by_default.confidence[0] == by_default.confidence[1:].max()


def test_one_shape_that_nobody_called_incomplete_is_the_model(by_default, animal, aligned):
    model, scans = animal
    clouds = [scan.points for scan in scans]
    names = ",".join(f"scan{n}" for n in range(NUM))
    called = aligned((model.vertices, model.faces), clouds, incomplete=names)
    np.testing.assert_array_equal(called.transforms, by_default.transforms)
    assert all(one.reason == "named" for one in called.incomplete)
    every = aligned((model.vertices, model.faces), clouds, incomplete="all")
    assert 0 in [one.shape for one in every.incomplete]


def test_a_scan_in_another_unit_is_not_placed(animal, aligned):
    model, scans = animal
    clouds = [1000.0 * scans[0].points, *(scan.points for scan in scans[1:])]
    collection = aligned((model.vertices, model.faces), clouds)
    assert collection.part_numbers.tolist() == [0, 1, *[0] * (NUM - 1)]
    assert collection.confidence[1] == 0.0


def test_another_object_is_no_model(animal, aligned):
    other = model_of("blobs", 3)
    collection = aligned((other.vertices, other.faces), [scan.points for scan in animal[1]])
    assert 0 in [one.shape for one in collection.incomplete]


def test_the_axis_of_a_shaft_is_named_and_its_turns_count_together(aligned):
    rng, shaft = np.random.default_rng(3), stepped_shaft()
    ways = ([1.0, 0.2, 0.4], [-0.3, 1.0, 0.4], [0.2, 0.8, -0.5])
    turns = [random_rotation(rng) for _ in ways]
    clouds = [
        range_view(shaft, np.array(way), noise=0.002, rng=rng) @ turn.T
        for way, turn in zip(ways, turns, strict=True)
    ]
    collection = aligned((shaft.vertices, shaft.faces), clouds)
    free = [note for note in collection.notes if note.code == "free-rotation"]
    assert {note.shapes for note in free} == {(f"scan{n}",) for n in range(len(ways))}
    for note in free:
        assert note.values["whole"] == "model"
        assert abs(float(str(note.values["axis"]).split()[2])) > 0.99
    assert (collection.confidence > 0.8).all()
    axes = on_the_model(collection)[:, :3, :3] @ np.stack(turns) @ [0.0, 0.0, 1.0]
    assert (axes[:, 2] > 0.99).all()


def test_an_animal_does_not_turn_freely(by_default):
    assert "free-rotation" not in codes(by_default.notes)
