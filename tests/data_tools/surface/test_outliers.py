import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob, crown, sphere_mesh
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.notes import Note
from data_tools.options import AS_STORED
from data_tools.surface.outliers import (
    apart_ratios,
    odd_for_covariate,
    odd_ratios,
    without_outliers,
)
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges


def with_slips(shape, rng, num=3):
    """Return the shape with vertices that share no edge 5 to 30 radii away, in directions of their own."""
    vertices, slipped = (
        shape.vertices.copy(),
        np.linspace(7, len(shape.vertices) - 9, num).astype(np.int64),
    )
    radius = float(np.linalg.norm(vertices - vertices.mean(axis=0), axis=1).max())
    away = rng.normal(size=(num, 3))
    away *= (radius * np.geomspace(5.0, 30.0, num) / np.linalg.norm(away, axis=1))[:, None]
    vertices[slipped] = vertices.mean(axis=0) + away
    return Shape.from_arrays(vertices, shape.faces, name=shape.name), slipped


def cone(height):
    """Return a cone whose rim is fine and whose tip is one vertex."""
    turns = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    rim = np.stack([np.cos(turns), np.sin(turns), np.zeros(200)], axis=1)
    at = np.arange(200)
    sides = np.stack([at, (at + 1) % 200, np.full(200, 201)], axis=1)
    floor = np.stack([(at + 1) % 200, at, np.full(200, 200)], axis=1)
    return Shape.from_arrays(
        np.concatenate([rim, [[0, 0, 0], [0, 0, height]]]), np.concatenate([sides, floor])
    )


@pytest.mark.parametrize("num", [1, 3, 8])
def test_vertices_out_of_place_are_left_out_and_the_surface_stays_closed(num, rng):
    slipped, which = with_slips(blob(rng, num_vertices=400), rng, num)
    found = without_outliers(slipped)
    np.testing.assert_array_equal(found.source_indices, np.delete(np.arange(400), which))
    np.testing.assert_array_equal(found.vertices, slipped.vertices[found.source_indices])
    assert not len(boundary_edges(found.faces))
    assert len(found.faces) == len(slipped.faces) - 2 * num
    assert np.bincount(found.faces.ravel(), minlength=400 - num).min() > 0
    times = pytest.approx(5.0 if num == 1 else 30.0, rel=0.1)
    assert found.notes[0] == Note(
        "far-points-left-out", values={"num": num, "points": "vertices", "times": times}
    )


def test_strays_near_a_cloud_are_left_out_and_thinly_scanned_sides_stay(rng):
    points = blob(rng, num_vertices=6000).vertices
    thin = points[(points[:, 0] > 0.0) | (rng.random(len(points)) < 1.0 / 8.0)]
    assert without_outliers(Shape.from_arrays(thin)).vertices.shape == thin.shape
    strays = rng.uniform(-1.5, 1.5, size=(len(thin) // 33, 3))
    found = without_outliers(Shape.from_arrays(np.concatenate([thin, strays])))
    kept = found.source_indices
    assert (kept < len(thin)).sum() >= 0.995 * len(thin)
    assert (kept >= len(thin)).sum() <= 0.25 * len(strays)
    assert found.notes[0].code == "stray-points-left-out"


def test_strays_of_a_small_cloud_stay_unless_they_are_asked_for(rng):
    points = rng.normal(size=(300, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    strays = rng.normal(size=(6, 3))
    strays *= 1.6 / np.linalg.norm(strays, axis=1, keepdims=True)
    cloud = Shape.from_arrays(np.concatenate([points, strays]))
    assert without_outliers(cloud) is cloud
    kept = without_outliers(cloud, fewest_points=100).source_indices
    assert set(range(300)) == {*kept.tolist()}


def test_long_shapes_tips_and_small_sets_stay(rng):
    vertices, faces = sphere_mesh(500)
    line = Shape.from_arrays(vertices * [30.0, 1.0, 0.5], faces)
    few = Shape.from_arrays(np.concatenate([rng.normal(size=(40, 3)), [[50.0, 0.0, 0.0]]]))
    many = Shape.from_arrays(
        np.concatenate([rng.normal(size=(380, 3)), rng.normal(size=(20, 3)) + 50.0])
    )
    for shape in (line, Shape.from_arrays(line.vertices), few, many, cone(30.0), crown(rng)):
        assert without_outliers(shape) is shape


def test_files_are_read_without_them_unless_asked_for_as_stored(rng, tmp_path):
    slipped, which = with_slips(blob(rng, num_vertices=400), rng)
    path = write_mesh(tmp_path / "slipped.ply", slipped)
    found = read_shape(path)
    np.testing.assert_array_equal(found.source_indices, np.delete(np.arange(400), which))
    assert read_shape(path, AS_STORED).notes == ()
    assert len(read_shape(path, AS_STORED).vertices) == 400


@pytest.mark.parametrize("factor", [10.0, 0.1, 25.4, 1000.0])
@pytest.mark.parametrize("place", [0, 6, 11])
def test_another_unit_is_named_though_sizes_differ_threefold(factor, place):
    sizes = {f"s{at}": size for at, size in enumerate(np.geomspace(1.0, 3.0, 12))}
    sizes[f"s{place}"] *= factor
    assert list(odd_ratios(sizes)) == [f"s{place}"]


def named(sizes):
    return dict(zip((f"s{at}" for at in range(len(sizes))), sizes, strict=True))


@pytest.mark.parametrize(("factor", "place"), [(2.0, 0), (2.0, 11), (3.0, 5), (0.5, 3), (2.54, 7)])
def test_a_size_two_or_three_times_that_of_the_others_is_named(factor, place, rng):
    sizes = np.exp(0.05 * rng.standard_normal(12))
    sizes[place] *= factor / sizes[place]
    (found,) = apart_ratios(named(sizes)).items()
    assert found == (f"s{place}", pytest.approx(factor, rel=0.06))
    for far in (1000.0, 10.0):
        with_unit = named([*sizes, far])
        assert [*apart_ratios(with_unit)] == [f"s{place}"]
        assert [*odd_ratios(with_unit)] == ["s12"]


def test_sizes_of_growth_of_one_range_and_of_few_are_not_apart(rng):
    """Names are for what one can tell: a share of draws far below that of a specimen at twice its size."""
    grown = [20.0 ** np.sort(rng.random(num)) for num in 50 * [8, 15, 30]]
    grown += [rng.uniform(1.0, 20.0, num) for num in 50 * [8, 15, 30]]
    ages = [rng.random(num) for num in 50 * [8, 15, 30]]
    grown += [1.0 - 0.95 * np.exp(-5.0 * age) for age in ages]
    assert sum(bool(apart_ratios(named(sizes))) for sizes in grown) <= 0.05 * len(grown)
    assert not apart_ratios(named(3 * 10 ** (np.arange(10) / 9)))
    assert not apart_ratios(named([1.0, 1.0, 1.0, 1.0, 2.0]))
    assert not apart_ratios({})
    assert not apart_ratios(named(np.repeat([1.0, 2.0], 6)))  # two kinds


def test_sizes_are_compared_with_a_covariate_that_they_follow(rng):
    ages = np.array([*np.linspace(1.0, 20.0, 11), np.nan])
    for grows in (lambda age: age**1.5, lambda age: np.exp(0.1 * age)):
        sizes = np.nan_to_num(grows(ages), nan=50.0) * np.exp(0.03 * rng.standard_normal(12))
        assert odd_for_covariate(sizes, ages) == {}
        sizes[6] *= 2.0
        assert odd_for_covariate(sizes, ages) == {6: pytest.approx(2.0, rel=0.15)}
    assert odd_for_covariate(rng.permutation(sizes), ages) is None
    assert odd_for_covariate(np.ones(12), ages) is None
    assert odd_for_covariate(sizes[:4], ages[:4]) is None
