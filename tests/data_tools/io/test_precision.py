"""Coordinates of maps: what single precision costs them is named, and no file that is written loses by it."""

import numpy as np
import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.shapes import (
    WRITABLE,
    coarse_note,
    fits_single,
    read_shape,
    write_mesh,
)
from data_tools.surface.shape import Shape

#: Easting, northing and height of a place on a map, in metres.
PLACE = np.array([456789.123, 5412345.678, 312.4])
BLOB = blob(np.random.default_rng(3), num_vertices=200)


def on_map(size):
    return Shape.from_arrays(
        BLOB.vertices * (size / np.linalg.norm(np.ptp(BLOB.vertices, axis=0))) + PLACE, BLOB.faces
    )


@pytest.mark.parametrize("suffix", WRITABLE)
def test_meshes_on_a_map_are_written_without_loss(tmp_path, suffix):
    shape = on_map(1.5)
    back = read_shape(write_mesh(tmp_path / f"a{suffix}", shape))
    order = np.lexsort(np.round(back.vertices, 6).T), np.lexsort(np.round(shape.vertices, 6).T)
    np.testing.assert_allclose(back.vertices[order[0]], shape.vertices[order[1]], rtol=0, atol=1e-6)
    np.testing.assert_allclose(back.area, shape.area, rtol=1e-6)
    assert coarse_note(back.vertices) == ()


def test_what_fits_single_precision():
    assert fits_single(BLOB.vertices)
    assert fits_single(BLOB.vertices + 5)
    assert not fits_single(BLOB.vertices + 1000)
    assert fits_single(np.full((3, 3), np.nan))
    assert not fits_single(np.array([[0, 0, 0], [1e200, 0, 0]]))


@pytest.mark.parametrize(("size", "share"), [(1.5, 33.3), (15.0, 3.3)])
def test_coarse_steps_are_named_with_what_they_cost(size, share):
    single = on_map(size).vertices.astype(np.float32).astype(float)
    (note,) = coarse_note(single)
    assert note.code == "coarse-steps"
    assert note.values == {"step": 0.5, "share": pytest.approx(share / 100, rel=0.1)}
    assert coarse_note(on_map(size).vertices) == ()
