"""Extra material is cut off a mesh, whose hole is closed, or left out of a cloud."""

import numpy as np

from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.surface.extra import ExtraSurface, without_extra
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges


def spiked():
    """Return a ball with a blunt spike, and what belongs to the spike."""
    points, faces = sphere_mesh(600)
    spike = points[:, 2] > 0.8
    return Shape.from_arrays(points * np.where(spike, 2.0, 1.0)[:, None], faces), spike


def extra_of(shape, is_extra):
    return ExtraSurface(points=shape.vertices[::2], is_extra=is_extra[::2])


def test_the_hole_in_a_mesh_is_closed():
    shape, spike = spiked()
    rest = without_extra(shape, extra_of(shape, spike))
    assert not len(boundary_edges(rest.faces))
    assert rest.vertices[:, 2].max() < 1.0
    assert 0.9 * (~spike).sum() <= len(rest.vertices) <= (~spike).sum() + 5
    assert (shape.vertices[rest.file_indices] == rest.vertices).all()
    assert rest.file_size == 600
    assert rest.notes == shape.notes


def test_clouds_and_parts_lose_points():
    shape, spike = spiked()
    cloud = Shape.from_arrays(shape.vertices)
    rest = without_extra(cloud, ExtraSurface(points=shape.vertices, is_extra=spike))
    assert (rest.file_indices == np.flatnonzero(~spike)).all()
    pair = Shape.of_parts("pair", [shape, Shape.from_arrays(shape.vertices + 9.0, shape.faces)])
    extra = ExtraSurface(points=pair.vertices, is_extra=np.concatenate([spike, 0 * spike > 0]))
    assert without_extra(pair, extra).parts[0][1] == (~spike).sum()
    assert without_extra(pair, extra).parts[1][1] == 600


def test_its_digest_follows_from_what_is_extra():
    shape, spike = spiked()
    one = extra_of(shape, spike)
    assert one.digest == extra_of(shape, spike).digest != extra_of(shape, ~spike).digest
