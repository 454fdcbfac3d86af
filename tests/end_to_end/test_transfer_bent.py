"""Landmarks of bodies that bend: maps of all vertices bring them to limbs that moved, poses alone do not."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import collalign
from collalign.output.vertex_maps import VERTEX_MAPS_FILE, save_vertex_maps
from data_tools.datasets.synthetic import bent, planted_collection
from data_tools.datasets.synthetic_shapes import figure
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import CollalignError
from data_tools.landmark_files import Landmarks
from data_tools.options import SamplingOptions
from tests.finished_runs import finished_run, on_files, radius
from tests.products import vertex_maps_of

BODY = figure(resolution=1)
NUM_SHAPES = 4
MARKS = farthest_points(BODY, 8, metric="euclidean")
LABELS = tuple(f"tip {i}" for i in range(8))
NAMES = tuple(f"body{i}" for i in range(NUM_SHAPES))


@pytest.fixture(scope="module")
def planted():
    """Bodies, the last vertex of whose files belongs to no triangle."""
    rng = np.random.default_rng(12)
    made = planted_collection(
        [replace(bent(BODY, rng, angle=0.8), name=name) for name in NAMES], rng
    )
    loose = tuple(
        replace(shape, vertices=np.vstack([shape.vertices, np.zeros(3)])) for shape in made.shapes
    )
    return replace(
        made, shapes=loose, origins=tuple(np.append(one, len(one)) for one in made.origins)
    )


@pytest.fixture(scope="module")
def result(planted, tmp_path_factory):
    options = collalign.AlignOptions(sampling=SamplingOptions(num_points=24))
    return finished_run(tmp_path_factory.mktemp("bent"), planted, options)


def exact_maps(planted, *, names=NAMES):
    """Return the true maps of some shapes, through the first, of which a twentieth is wrong."""
    rng, at_rest = np.random.default_rng(3), on_files(planted, np.arange(len(BODY.vertices) + 1))
    on_reference = []
    for name in names:
        own = at_rest[0][planted.origins[NAMES.index(name)]]
        wrong = rng.random(len(own)) < 0.05
        own[wrong] = rng.permutation(own)[wrong]
        on_reference.append(own)
    return vertex_maps_of(names, on_reference)


def with_maps(result, maps, to):
    shutil.copytree(result, to)
    save_vertex_maps(maps, to / VERTEX_MAPS_FILE)
    return to


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return collalign.RunOptions(jobs=1, store=tmp_path_factory.mktemp("store") / "store.sqlite")


def carried(out, planted, run):
    """Carry landmarks of the first shape to all and return the errors of the others, in radii, by shape."""
    true = on_files(planted, MARKS)
    given = {NAMES[0]: Landmarks(labels=LABELS, points=true[0])}
    found = collalign.landmarks.transfer_landmarks(out, given, run=run, progress=False)
    assert found.names == NAMES
    units = [radius(shape.vertices) for shape in planted.shapes]
    errors = np.linalg.norm(found.points - true, axis=2) / np.array(units)[:, None]
    return np.asarray(errors[1:].mean(axis=1))


def test_maps_bring_landmarks_to_limbs_that_moved(result, planted, tmp_path, run):
    alone = carried(result, planted, run)
    mapped = carried(with_maps(result, exact_maps(planted), tmp_path / "mapped"), planted, run)
    assert mapped.max() < 0.06
    # Without maps, a landmark of a limb that moved may find no place.
    assert mapped.mean() < 0.5 * np.nanmean(alone)


def test_shapes_without_maps_are_registered_from_their_poses(result, planted, tmp_path, run):
    maps = exact_maps(planted, names=NAMES[:3])
    some = collalign.maps.dense_correspondence(
        with_maps(result, maps, tmp_path / "some"), run=run, progress=False
    )
    assert some.names == NAMES
    elsewhere = replace(
        exact_maps(planted, names=NAMES[:1]), names=("elsewhere",), reference="elsewhere"
    )
    of_none = with_maps(result, elsewhere, tmp_path / "none")
    bare, own = (
        collalign.maps.dense_correspondence(out, run=run, progress=False)
        for out in (result, of_none)
    )
    np.testing.assert_array_equal(own.vertices, bare.vertices)


def test_maps_of_other_files_are_refused(result, planted, tmp_path, run):
    maps = exact_maps(planted)
    fewer = replace(
        maps,
        places=tuple(own[:-1] for own in maps.places),
        vertex_confidence=tuple(own[:-1] for own in maps.vertex_confidence),
    )
    with pytest.raises(CollalignError, match=r"its maps are of \d+ vertices"):
        collalign.maps.dense_correspondence(
            with_maps(result, fewer, tmp_path / "fewer"), run=run, progress=False
        )
