import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.sampling import central_extreme, farthest_points
from data_tools.errors import InputError, OptionsError
from data_tools.surface.geodesics import GeodesicSolver
from data_tools.surface.shape import Shape


@pytest.mark.parametrize("metric", ["geodesic", "euclidean"])
def test_each_point_is_the_farthest_and_gaps_shrink(metric, rng):
    shape = blob(rng, num_vertices=500)
    chosen = farthest_points(shape, 30, metric=metric)
    assert len(set(chosen)) == 30
    assert chosen[0] == central_extreme(shape.vertices)
    solver = GeodesicSolver(shape)
    gaps = []
    nearest = np.full(500, np.inf)
    for vertex in chosen:
        assert nearest[vertex] == nearest.max()
        gaps.append(nearest[vertex])
        away = np.linalg.norm(shape.vertices - shape.vertices[vertex], axis=1)
        nearest = np.minimum(
            nearest, solver.from_vertex(int(vertex)) if metric == "geodesic" else away
        )
        nearest[vertex] = 0.0
    assert (np.diff(gaps[1:]) <= 1e-12).all()


def test_seeds_come_first(rng):
    shape = blob(rng, num_vertices=300)
    assert farthest_points(shape, 5, seeds=[7, 200, 30])[:3].tolist() == [7, 200, 30]
    assert farthest_points(shape, 2, seeds=[7, 200, 30]).tolist() == [7, 200]


def test_too_few_points_are_refused_by_name(rng):
    shape = blob(rng, num_vertices=50, name="small")
    with pytest.raises(InputError, match="small: 50 vertices, 51 samples"):
        farthest_points(shape, 51)
    repeated = Shape.from_arrays(np.repeat(shape.vertices[:5], 4, axis=0), name="repeated")
    with pytest.raises(InputError, match="repeated: only 5 distinct points"):
        farthest_points(repeated, 6, metric="euclidean")
    with pytest.raises(InputError, match="seeds"):
        farthest_points(shape, 5, seeds=[50])
    with pytest.raises(InputError, match="distinct"):
        farthest_points(shape, 5, seeds=[3, 3])
    with pytest.raises(OptionsError, match="metric"):
        farthest_points(shape, 5, metric="taxicab")
