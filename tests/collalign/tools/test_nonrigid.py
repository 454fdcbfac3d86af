"""Non-rigid matching end to end on a generated near-isometric pair with a known dense map, and its parts."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.tools.match.nonrigid import match_prepared, match_shapes
from collalign.tools.match.pictures import match_picture, transferred_colours, vertices_map
from data_tools.datasets.synthetic import bent, mirrored, point_cloud, shuffled
from data_tools.datasets.synthetic_shapes import figure
from data_tools.errors import InputError, OptionsError
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.maps.evaluation import MapEvaluator

SMALL = SurfaceOptions(num_functions=45, num_samples=60, num_dense=300)
QUICK = NonrigidOptions()
pytestmark = pytest.mark.usefixtures("quick_search")


@pytest.fixture(scope="module")
def pair():
    """A figure, a bent, rotated, shuffled copy of it, and the target vertex of each of its vertices."""
    rng = np.random.default_rng(3)
    target = figure()
    posed = bent(target, rng, angle=0.6)
    source, truth = shuffled(
        Shape.from_arrays(posed.vertices @ random_rotation(rng).T, posed.faces), rng
    )
    return target, source, truth


@pytest.fixture(scope="module")
def prepared(pair):
    return prepare_surface(pair[0], SMALL), prepare_surface(pair[1], SMALL)


@pytest.fixture(scope="module")
def files(pair, tmp_path_factory):
    """The pair as files."""
    folder = tmp_path_factory.mktemp("nonrigid")
    target, source = (
        write_mesh(folder / f"{name}.ply", shape)
        for name, shape in zip("ab", pair[:2], strict=True)
    )
    return target, source


@pytest.fixture(scope="module")
def match(files):
    """The pair matched from its files."""
    return match_shapes(*files, options=QUICK, surface_options=SMALL)


def mean_error(target, images, truth, *, num=100):
    chosen = np.linspace(0, len(truth) - 1, num).astype(int)
    return float(MapEvaluator(target, truth[chosen]).errors(images[chosen]).direct.mean())


def test_portfolio_finds_the_dense_map(pair, match):
    target, source, truth = pair
    assert match.point_map_target_source.shape == (len(source.vertices),)
    assert match.point_map_source_target.shape == (len(target.vertices),)
    assert mean_error(target, match.point_map_target_source, truth) < 0.015
    assert mean_error(source, match.point_map_source_target, np.argsort(truth)) < 0.015
    assert match.orientation == "preserving"
    assert 0.0 < match.confidence <= 1.0
    scores = [
        c.evidence.score
        for c in match.candidates
        if c.orientation == "preserving" and c.origin != "poses"
    ]
    assert scores == sorted(scores)


def test_a_mirror_image_is_detected_as_such(pair, prepared):
    target, source, truth = pair
    reflection = prepare_surface(mirrored(source), SMALL)
    match = match_prepared(prepared[0], reflection, replace(QUICK, orientation="any"))
    assert match.orientation == "reversing"
    assert mean_error(target, match.point_map_target_source, truth) < 0.03


def test_maps_are_written_to_files(tmp_path, match):
    npz, text, back = sorted(match.save(tmp_path / "out"))
    assert np.array_equal(np.loadtxt(back, dtype=np.int64), match.point_map_source_target)
    with np.load(npz, allow_pickle=False) as stored:
        assert np.array_equal(stored["point_map_target_source"], match.point_map_target_source)
        assert len(stored["candidate_maps"]) == len(match.candidates)
        for name in ("source", "target"):
            assert not stored[f"no_counterpart_{name}"].any(), "neither surface is cut"
    assert np.array_equal(np.loadtxt(text, dtype=np.int64), match.point_map_target_source)


def test_poor_meshes_work_or_say_what_to_do(pair, prepared):
    target = pair[0]
    fin = np.vstack(
        [target.faces, [[target.faces[0, 0], target.faces[0, 1], len(target.vertices)]]]
    )
    own, top = np.arange(len(target.vertices)), target.vertices[target.faces[0]].mean(axis=0) * 1.05
    finned = Shape.from_arrays(np.vstack([target.vertices, top]), fin, name="finned")
    turned = np.where(
        np.arange(len(target.faces))[:, None] % 2 == 0, target.faces[:, ::-1], target.faces
    )
    for shape in (finned, replace(target, faces=turned)):
        match = match_prepared(prepare_surface(shape, SMALL), prepare_surface(target, SMALL), QUICK)
        assert mean_error(target, match.point_map_source_target[: len(own)], own) < 0.05
    few = Shape.from_arrays(
        target.vertices[target.faces[:40]].reshape(-1, 3), np.arange(120).reshape(-1, 3)
    )
    with pytest.raises(InputError, match="num_functions"):
        prepare_surface(few, SMALL)


def test_point_clouds_match_without_normals(pair, rng):
    options = replace(SMALL, num_functions=40)
    clouds = [prepare_surface(point_cloud(shape, rng), options) for shape in pair[:2]]
    match = match_prepared(*clouds, QUICK)
    assert match.orientation == "unknown"
    assert max(match.confidence, *match.vertex_confidence) <= 0.5
    assert mean_error(pair[0], match.point_map_target_source, pair[2]) < 0.3


def test_mismatched_shapes_are_refused(prepared):
    small = prepared[0]
    other = replace(small, eigenvalues=small.eigenvalues[:40], functions=small.functions[:, :40])
    with pytest.raises(InputError, match="eigenfunctions"):
        match_prepared(small, other, QUICK)


def test_options_check_themselves():
    for wrong in ({"orientation": "reversed"}, {"num_candidates": 0}):
        with pytest.raises(OptionsError, match=next(iter(wrong))):
            NonrigidOptions(**wrong)
    with pytest.raises(OptionsError, match="num_dense"):
        SurfaceOptions(num_functions=100, num_dense=150)


def test_pictures_colour_both_shapes_alike(pair):
    target, source, truth = pair
    images = np.where(np.arange(len(truth)) < 5, -1, truth)
    of_target, of_source = transferred_colours(target, images)
    assert np.array_equal(of_source[5:], of_target[truth[5:]])
    assert np.ptp(of_source[:5]) == 0.0
    assert 0.0 <= of_target.min() <= of_target.max() <= 1.0
    pixels = np.asarray(match_picture(target, source, images, np.linspace(0, 1, len(truth))))
    panels = pixels[-290:].reshape(290, 6, 290, 3).transpose(1, 0, 2, 3)
    assert (panels.min(axis=(1, 2, 3)) < 200).all(), "both shapes and the confidence, twice each"
    assert (pixels[:-290].min(axis=2) < 100).any(), "words above the panels"
    assert pixels[:-290].std(axis=2).max() == 0.0, "and nothing in colour"
    with pytest.raises(InputError, match="names vertex"):
        transferred_colours(target, truth + 1)


def test_maps_of_files_become_maps_of_shapes_without_the_vertices_that_were_dropped():
    kept = [0, 2, 3], [1, 2]
    target, source = (
        replace(Shape.from_arrays(np.eye(4)[one, :3]), source_indices=np.array(one)) for one in kept
    )
    assert vertices_map(np.array([-1, 3, 0]), target, source).tolist() == [2, 0]
    assert vertices_map(np.array([0, 1, -1]), target, source).tolist() == [-1, -1]
    whole, images = Shape.from_arrays(np.eye(4)[:, :3]), np.array([3, 2, -1, 0])
    assert np.array_equal(vertices_map(images, whole, whole), images)
