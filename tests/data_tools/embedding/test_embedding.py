from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.datasets.synthetic import mirrored, point_cloud, shuffled
from data_tools.datasets.synthetic_shapes import blob, crown, sphere_mesh
from data_tools.embedding import working_surface
from data_tools.embedding.embedding import Samples, sample_file, sample_shape
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape
from tests.data_tools.surface.test_joined import boxes

FEW = SamplingOptions(num_points=24, num_dense_points=60)
ALL = EmbeddingOptions(kind="all", agd_weight=0.1)


@pytest.fixture(scope="module")
def shape():
    return blob(np.random.default_rng(3), num_vertices=700)


@pytest.mark.parametrize(
    ("kind", "dim", "num_invariants"),
    [("xyz", 3, 0), ("xyz+lb", 7, 0), ("xyz+invariants", 3, 6), ("all", 7, 6)],
)
def test_blocks_of_each_kind(shape, kind, dim, num_invariants):
    samples = sample_shape(shape, FEW, EmbeddingOptions(kind=kind))
    assert samples.coordinates.shape == (24, dim)
    assert samples.invariants.shape == (24, num_invariants)
    assert samples.block_sizes == ((3,) if dim == 3 else (3, 4))
    np.testing.assert_array_equal(samples.coordinates[:, :3], samples.positions)
    arrays = [getattr(samples, f.name) for f in fields(Samples)]
    assert all(
        not a.flags.writeable and a.flags.c_contiguous for a in arrays if isinstance(a, np.ndarray)
    )


def test_positions_undo_to_vertices(shape):
    for normalisation in ("centroid", "area", "none"):
        options = SamplingOptions(num_points=24, num_dense_points=60, normalisation=normalisation)
        samples = sample_shape(shape, options)
        back = samples.positions * samples.scale + samples.offset
        np.testing.assert_allclose(back, shape.vertices[samples.vertex_indices], atol=1e-12)
        back = samples.dense_positions * samples.scale + samples.offset
        np.testing.assert_allclose(back, shape.vertices[samples.dense_indices], atol=1e-12)
        np.testing.assert_allclose(samples.positions.mean(axis=0), 0.0, atol=1e-12)
        expected = {
            "centroid": np.linalg.norm(samples.positions) * samples.scale,
            "area": shape.area**0.5,
            "none": 1.0,
        }
        assert samples.scale == pytest.approx(expected[normalisation])
    assert np.linalg.norm(sample_shape(shape, FEW).positions) == pytest.approx(1.0)


def test_weights_are_squared_norms_relative_to_positions():
    options = EmbeddingOptions(kind="all", hks_weight=0.4, agd_weight=0.8)
    for normalisation in ("centroid", "none"):
        sampling = SamplingOptions(num_points=24, num_dense_points=0, normalisation=normalisation)
        samples = sample_shape(crown(num_vertices=600), sampling, options)
        size = np.linalg.norm(samples.positions)
        assert np.linalg.norm(samples.coordinates[:, 3:]) ** 2 == pytest.approx(0.3 * size**2)
        assert np.linalg.norm(samples.invariants[:, :4]) ** 2 == pytest.approx(0.1 * size**2)
        assert np.linalg.norm(samples.invariants[:, 4]) ** 2 == pytest.approx(0.2 * size**2)
        assert np.linalg.norm(samples.invariants[:, 5]) ** 2 == pytest.approx(0.05 * size**2)


def test_invariants_weigh_less_on_open_surfaces_and_point_clouds(shape, rng):
    for other, share in (
        (crown(num_vertices=600), 0.25),
        (point_cloud(shape, rng), 0.25),
        (shape, 1.0),
    ):
        samples = sample_shape(other, FEW, EmbeddingOptions(agd_weight=0.4))
        of_agd = (samples.invariants[:, 4] ** 2).sum() / (samples.positions**2).sum()
        assert of_agd == pytest.approx(0.4 * share)


def test_pose_scale_and_vertex_order_only_turn_the_positions(shape, rng):
    rotation = random_rotation(rng)
    moved = Shape.from_arrays(3.0 * shape.vertices @ rotation.T + [5, 6, 7], shape.faces)
    mixed, origin = shuffled(moved, rng)
    a, b = sample_shape(shape, FEW, ALL), sample_shape(mixed, FEW, ALL)
    np.testing.assert_array_equal(origin[b.vertex_indices], a.vertex_indices)
    np.testing.assert_allclose(b.positions, a.positions @ rotation.T, atol=1e-9)
    np.testing.assert_allclose(b.coordinates[:, 3:], a.coordinates[:, 3:], atol=1e-6)
    np.testing.assert_allclose(b.invariants, a.invariants, atol=1e-6)
    np.testing.assert_allclose(b.dense_positions, a.dense_positions @ rotation.T, atol=1e-9)


def test_mirror_images_have_mirrored_samples(shape):
    a, b = sample_shape(shape, FEW, ALL), sample_shape(mirrored(shape), FEW, ALL)
    np.testing.assert_array_equal(a.vertex_indices, b.vertex_indices)
    np.testing.assert_allclose(b.positions, a.positions * [-1, 1, 1], atol=1e-12)
    np.testing.assert_allclose(b.invariants, a.invariants, atol=1e-6)


def test_auto_samples_closed_surfaces_along_and_open_ones_through_space(shape):
    def indices(s, metric):
        options = SamplingOptions(num_points=24, num_dense_points=0, metric=metric)
        return sample_shape(s, options, EmbeddingOptions(kind="xyz")).vertex_indices.tolist()

    opened = crown(num_vertices=600)
    assert indices(shape, "auto") == indices(shape, "geodesic") != indices(shape, "euclidean")
    assert indices(opened, "auto") == indices(opened, "euclidean") != indices(opened, "geodesic")


def test_large_meshes_are_decimated_but_samples_are_their_own_vertices():
    shape = blob(np.random.default_rng(0), num_vertices=3000, name="large")
    options = SamplingOptions(num_points=24, num_dense_points=60, max_faces=1500)
    samples = sample_shape(shape, options, ALL)
    assert (samples.notes[-1].code, samples.notes[-1].values["before"]) == ("decimated", 5996)
    full = sample_shape(shape, FEW, ALL)
    np.testing.assert_allclose(samples.scale, full.scale, rtol=0.03)
    np.testing.assert_allclose(
        samples.positions * samples.scale + samples.offset,
        shape.vertices[samples.vertex_indices],
        atol=1e-12,
    )


def test_samples_whose_nearest_vertex_is_one_get_two_near_each_other():
    shape = blob(np.random.default_rng(0), num_vertices=3000)
    surface = WorkingSurface(shape, SamplingOptions(num_points=24, max_faces=1500))
    first, second = surface.farthest_points(24, "geodesic", seeded=True)[:2]
    surface.to_original[second] = surface.to_original[first]
    samples = sample_shape(
        shape, SamplingOptions(num_points=24, max_faces=1500), ALL, surface=surface
    )
    assert len(set(samples.vertex_indices.tolist())) == 24


def test_unusable_shapes_are_refused_by_name(shape):
    small = Shape.from_arrays(*sphere_mesh(20), name="small")
    with pytest.raises(InputError, match="small: 3 points do not determine a pose; 4 are needed"):
        sample_shape(Shape.from_arrays(np.eye(3), name="small"), FEW)
    few = SamplingOptions(num_points=8, num_dense_points=0)
    with pytest.raises(InputError, match="small: too few vertices for 30 eigenfunctions"):
        sample_shape(small, few, EmbeddingOptions(kind="xyz+lb", num_eigenfunctions=30))
    assert sample_shape(small, few).invariants.shape == (8, 6)


def test_samples_of_joined_components_lie_between_their_few_vertices(tmp_path):
    """A table of two boxes has sixteen vertices: its samples lie anywhere on it, with normals that point outwards."""
    table = boxes(((4, 3, 0.5), (0, 0, 2)), ((0.6, 0.6, 2), (1.7, 1.2, 0)))
    file = write_mesh(tmp_path / "table.ply", table)
    found = sample_file(file, CleaningOptions(components="all"), FEW, EmbeddingOptions(), name="a")
    assert found.positions.shape == (24, 3)
    assert len(found.dense_positions) == 60
    assert found.rim == "closed"
    assert found.vertex_indices.max() < 16
    for positions in (found.positions, found.dense_positions):
        places = positions * found.scale + found.offset
        nearest = SurfaceLocator(table.vertices, table.faces).closest(places).on(table.vertices)
        np.testing.assert_allclose(places, nearest, atol=1e-6)
    top = found.dense_positions * found.scale + found.offset
    on_top = (top[:, 2] > 2.49) & (np.abs(top[:, :2] - [2.0, 1.5]) < [1.7, 1.2]).all(axis=1)
    assert on_top.sum() > 5
    assert (found.dense_normals[on_top, 2] > 0.9).all()


def test_dense_samples_of_joined_components_begin_with_their_vertices_outside(
    tmp_path, monkeypatch
):
    """A drawer lies inside a table's board; its other vertices are where no sampling would put a point."""
    table = boxes(
        ((4, 3, 1), (0, 0, 2)), ((0.6, 0.6, 2), (1.7, 1.2, 0)), ((1, 1, 0.4), (1.5, 1, 2.3))
    )
    file = write_mesh(tmp_path / "table.ply", table)
    found = sample_file(file, CleaningOptions(components="all"), FEW, EmbeddingOptions(), name="a")
    places = found.dense_positions * found.scale + found.offset
    gaps, nearest = cKDTree(places).query(table.vertices)
    outside = [*range(8), 8, 10, 12, 14]  # the leg's other four touch the board
    np.testing.assert_allclose(gaps[outside], 0.0, atol=1e-6)
    assert sorted(nearest[outside].tolist()) == [*range(12)]
    assert (gaps[16:] > 0.1).all()
    monkeypatch.setattr(working_surface, "OUTSIDE_CELLS", 0.0)  # as if all lay inside
    found = sample_file(file, CleaningOptions(components="all"), FEW, EmbeddingOptions(), name="a")
    assert len(found.dense_positions) == len(found.dense_normals) == 60


def test_samples_of_a_mesh_of_few_vertices_lie_between_them(tmp_path):
    box = boxes(((4, 3, 0.5), (0, 0, 2)))
    file = write_mesh(tmp_path / "box.ply", box)
    found = sample_file(
        file, CleaningOptions(), FEW, EmbeddingOptions(), name="a", with_chirality=True
    )
    assert (found.num_places, found.is_poor) == (24, False)
    assert len(found.dense_positions) == len(found.dense_normals) == 60
    assert found.vertex_indices.max() < 8
    places = found.positions * found.scale + found.offset
    assert len(np.unique(places.round(6), axis=0)) == 24
    on_box = SurfaceLocator(box.vertices, box.faces).closest(places).on(box.vertices)
    np.testing.assert_allclose(places, on_box, atol=1e-6)
    assert not len(found.chirality.faces), "so coarse a surface turns neither way"


def test_points_of_a_small_cloud_count_several_times(rng):
    cloud = Shape.from_arrays(rng.standard_normal((30, 3)), name="small")
    found = sample_shape(cloud, SamplingOptions(num_points=64))
    assert found.positions.shape == (64, 3)
    assert sorted({*np.bincount(found.vertex_indices).tolist()}) == [2, 3]
    assert (found.num_places, found.is_poor) == (30, True)
    np.testing.assert_allclose(found.positions.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.positions), 1.0)


def test_a_table_of_too_few_points_for_a_surface_has_no_signatures(rng):
    few, enough = (
        sample_shape(Shape.from_arrays(rng.standard_normal((num, 3)), name="table"), FEW)
        for num in (16, 17)
    )
    assert few.invariants.shape == enough.invariants.shape == (24, 6)
    assert not few.invariants[:, :4].any()
    assert enough.invariants[:, :4].any(axis=0).all()
    assert few.is_table
    assert not few.may_be_cut
