"""A collection that lies in memory is aligned exactly like the same collection in a folder."""

import sys

import numpy as np
import pytest
import trimesh

from collalign import AlignOptions, RunOptions, add_to_collection, align_collection
from collalign.tools.export.run import export
from data_tools.errors import InputError
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import read_shape
from data_tools.options import SamplingOptions
from tests.commands import read_json
from tests.finished_runs import chairs

OPTIONS = AlignOptions(sampling=SamplingOptions(num_points=24, num_dense_points=0))


@pytest.fixture(scope="module")
def planted():
    return chairs(3)


def align(shapes, **run):
    return align_collection(shapes, options=OPTIONS, run=RunOptions(jobs=1, **run), progress=False)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return tmp_path_factory.mktemp("store") / "store.sqlite"


@pytest.fixture(scope="module")
def from_memory(planted, store):
    meshes = [trimesh.Trimesh(s.vertices, s.faces, process=False) for s in planted.shapes[1:]]
    first = planted.shapes[0]
    return align({"a": (first.vertices, first.faces), "b": meshes[0], "c": meshes[1]}, store=store)


def test_memory_and_folder_give_the_same_result(planted, from_memory, tmp_path):
    for name, shape in zip("abc", planted.shapes, strict=True):
        np.savez(tmp_path / f"{name}.npz", vertices=shape.vertices, faces=shape.faces)
    found = align(sorted(tmp_path.iterdir(), reverse=True))
    assert list_shapes(tmp_path).names == found.names == from_memory.names
    np.testing.assert_array_equal(found.transforms, from_memory.transforms)
    np.testing.assert_array_equal(found.maps.labels, from_memory.maps.labels)
    assert found.digests == from_memory.digests


def test_objects_of_open3d_are_aligned_and_given_back(
    planted, from_memory, store, tiny3d, monkeypatch
):
    given = {}
    for name, shape in zip("abc", planted.shapes, strict=True):
        given[name] = tiny3d.geometry.TriangleMesh()
        given[name].vertices = tiny3d.utility.Vector3dVector(shape.vertices.copy())
        given[name].triangles = tiny3d.utility.Vector3iVector(shape.faces.astype(np.int32))
    found = align(given, store=store)
    np.testing.assert_array_equal(found.transforms, from_memory.transforms)
    monkeypatch.setitem(sys.modules, "open3d", tiny3d)
    for at, mesh in enumerate(found.to_open3d().values()):
        moved = given[found.names[at]].transform(found.transforms[at])
        assert type(mesh) is type(moved)
        np.testing.assert_allclose(np.asarray(mesh.vertices), np.asarray(moved.vertices))
        np.testing.assert_array_equal(np.asarray(mesh.triangles), np.asarray(moved.triangles))


@pytest.mark.usefixtures("from_memory")
def test_the_store_knows_shapes_by_their_content_and_a_bad_one_is_left_out_by_its_name(
    planted, store
):
    found = align([*planted.shapes, np.full((30, 3), 2.0)], store=store)
    assert found.run.num_reused == 6
    assert [(item.file, item.reason) for item in found.excluded] == [
        ("shape4", "all points lie in one place")
    ]


def test_saved_results_say_that_there_are_no_files(from_memory, tmp_path):
    out, to = tmp_path / "out", tmp_path / "to"
    from_memory.save(out)
    assert [shape["file"] for shape in read_json(out / "alignment.json")["shapes"]] == ["", "", ""]
    assert len(read_shape(out / "meshes" / "b.ply").vertices)
    export(out, "tps", to)
    with pytest.raises(InputError, match="a: came from memory"):
        export(out, "ply", to)
    with pytest.raises(InputError, match="a: came from memory"):
        add_to_collection(out, tmp_path, progress=False)
    assert len(export(out, "ply", to, sources=out / "meshes", space="raw")) == 3
