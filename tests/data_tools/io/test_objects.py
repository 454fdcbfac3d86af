"""Arrays and the objects of other libraries are listed and read like files."""

import pickle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.objects import as_origin, list_shapes
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.io.source import Source, hash_source, location


@pytest.fixture
def shape(rng):
    return blob(rng, num_vertices=60)


class Tensor:
    """A tensor as Open3D's: its array is to be had after it came to the memory of the CPU."""

    def __init__(self, array):
        self.array = array

    def cpu(self):
        return SimpleNamespace(numpy=lambda: self.array)


def read(given):
    return read_shape(as_origin(given, "it"), name="it")


def test_every_kind_of_mesh_gives_the_same_shape(shape, tmp_path):
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    tensors = SimpleNamespace(
        vertex={"positions": Tensor(shape.vertices)}, triangle={"indices": Tensor(shape.faces)}
    )
    file = tmp_path / "it.npz"
    np.savez(file, vertices=shape.vertices, faces=shape.faces)
    for given in (
        mesh,
        tensors,
        shape,
        (shape.vertices, shape.faces),
        [shape.vertices.tolist(), shape.faces],
        file,
    ):
        found = read(given)
        np.testing.assert_array_equal(found.vertices, shape.vertices)
        np.testing.assert_array_equal(found.faces, shape.faces)
    assert read(mesh).file is None
    assert read(file).file == file


def test_every_kind_of_cloud_gives_its_points(shape):
    points = shape.vertices
    for given in (
        points,
        points.tolist(),
        trimesh.PointCloud(points),
        SimpleNamespace(points=points),
        SimpleNamespace(point={"positions": Tensor(points)}),
        SimpleNamespace(vertex={"positions": Tensor(points)}, triangle={}),
        (points, None),
    ):
        found = read(given)
        assert not found.is_mesh
        np.testing.assert_array_equal(found.vertices, points)


@pytest.mark.parametrize("library", ["open3d", "tiny3d"])
def test_objects_of_open3d_are_read(shape, library, request):
    found = request.getfixturevalue(library)
    mesh, cloud = found.geometry.TriangleMesh(), found.geometry.PointCloud()
    mesh.vertices = cloud.points = found.utility.Vector3dVector(shape.vertices.copy())
    mesh.triangles = found.utility.Vector3iVector(shape.faces.astype(np.int32))
    for given in (mesh, cloud):
        np.testing.assert_array_equal(read(given).vertices, shape.vertices)
    np.testing.assert_array_equal(read(mesh).faces, shape.faces)
    assert not read(cloud).is_mesh


def test_a_scene_of_trimesh_is_the_mesh_that_it_shows(shape):
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    np.testing.assert_array_equal(read(trimesh.Scene(mesh)).vertices, shape.vertices)


def test_the_content_of_a_source_decides_its_digest_and_travels_to_workers(shape):
    first, again = (as_origin(shape, name) for name in ("a", "b"))
    moved = as_origin((shape.vertices + 1.0, shape.faces), "a")
    assert hash_source(first) == hash_source(again) != hash_source(moved)
    copy = pickle.loads(pickle.dumps(first))
    assert isinstance(copy, Source)
    assert copy.digest == hash_source(first)
    assert (location(first), location(Path("a.ply"))) == ("", "a.ply")


def test_several_places_are_told_apart_whatever_they_hold(shape, tmp_path):
    a, b = tmp_path / "left", tmp_path / "right"
    for name in ("l1", "l2"):
        write_mesh(a / f"{name}.ply", shape)
    write_mesh(b / "r1.ply", shape)
    assert list_shapes([a, b]).names == ("left/l1", "left/l2", "right/r1")
    assert list_shapes([a / "*1.ply", b / "*"]).names == ("left/l1", "right/r1")
    assert list_shapes([a / "l1.ply", b / "r1.ply"]).names == ("l1", "r1")
    write_mesh(b / "l1.ply", shape)
    assert list_shapes([a, b]).names == ("left/l1", "left/l2", "right/l1", "right/r1")
    assert list_shapes([a / "l1.ply", b / "l1.ply"]).names == ("left/l1", "right/l1")
    assert list_shapes([a, a / "l1.ply"]).names == ("l1", "l2")


def test_a_list_names_shapes_by_file_own_name_or_position(shape, tmp_path):
    file = write_mesh(tmp_path / "tooth2.ply", shape)
    listing = list_shapes([shape.vertices, file, trimesh.Trimesh(shape.vertices, shape.faces)])
    assert listing.names == ("shape1", "shape3", "tooth2")
    assert listing.files[2] == file
    assert list_shapes({"b10": shape.vertices, "b2": file}).names == ("b2", "b10")
    assert list_shapes(np.stack([shape.vertices] * 3)).names == ("shape1", "shape2", "shape3")
    assert list_shapes(tmp_path).names == ("tooth2",)
    listing = list_shapes([shape.vertices, tmp_path, file, str(tmp_path / "*.ply")])
    assert listing.names == ("shape1", "tooth2"), "a file that several places hold is there once"
    assert list_shapes(listing) is listing
    assert list_shapes(str(tmp_path / "*2.ply")).names == ("tooth2",)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros((5, 3)), "several shapes in a list"),
        (3, "expected a folder, a list or a dict"),
        ([], "there are none"),
        ({1: np.zeros((5, 3))}, "names must be text"),
        ([object()], "shape1: expected a file, an array"),
        ([np.zeros((3, 50))], "give its transpose"),
        ([np.zeros((5, 2))], r"expected points of shape \(n, 3\)"),
        ([(np.zeros((5, 3)), np.zeros((2, 3)))], "faces as integers"),
        ([[["a", "b", "c"]]], "not arrays of numbers"),
        ([SimpleNamespace(points=None)], r"expected points of shape \(n, 3\)"),
        ([SimpleNamespace(name="x", points=np.eye(3))] * 2, "two of them have the same name"),
    ],
)
def test_what_is_no_collection_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        list_shapes(given)
