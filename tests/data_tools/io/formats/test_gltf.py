"""glTF of every kind of number, node and primitive, on files made by hand; trimesh reads some of them as well."""

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError, UnavailableError
from data_tools.io.formats.gltf import read_gltf
from data_tools.io.formats.raw_shape import not_kept
from data_tools.io.listing import hash_shape
from data_tools.io.shapes import read_shape
from data_tools.io.source import Source, read_source
from tests.memory import most_memory

MESH = blob(np.random.default_rng(3), num_vertices=60)
CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
QUARTER = [0.0, 0.0, 0.5**0.5, 0.5**0.5]
QUARTER_TURN = Rotation.from_quat(QUARTER).as_matrix()


class Scene:
    """A document that grows by buffers and accessors."""

    def __init__(self):
        self.data = b""
        self.document = {
            "asset": {"version": "2.0"},
            "accessors": [],
            "bufferViews": [],
            "buffers": [{}],
            "nodes": [],
        }
        self.document |= {"meshes": [], "scene": 0, "scenes": [{"nodes": []}]}

    def view(self, values, stride=0):
        """Keep rows of numbers, apart by so many bytes, and return the number of their view."""
        rows = np.atleast_2d(values.T).T
        width = rows.dtype.itemsize * rows.shape[1]
        padded = np.zeros((len(rows), stride or width), np.uint8)
        padded[:, :width] = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), width)
        entry = {"buffer": 0, "byteOffset": len(self.data), "byteLength": padded.size}
        self.document["bufferViews"].append(entry | ({"byteStride": stride} if stride else {}))
        self.data += padded.tobytes()
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values, *, stride=0, **more):
        rows = np.atleast_2d(values.T).T
        entry = {
            "bufferView": self.view(values, stride),
            "componentType": CODES[values.dtype.str[1:]],
        }
        entry |= {"count": len(rows), "type": {1: "SCALAR", 3: "VEC3"}[rows.shape[1]]} | more
        self.document["accessors"].append(entry)
        return len(self.document["accessors"]) - 1

    def mesh(self, *primitives, **more):
        self.document["meshes"].append({"primitives": list(primitives)} | more)
        return len(self.document["meshes"]) - 1

    def node(self, *, root=True, **node):
        self.document["nodes"].append(node)
        at = len(self.document["nodes"]) - 1
        self.document["scenes"][0]["nodes"] += [at] * root
        return at

    def plain(self, vertices=MESH.vertices, faces=MESH.faces, **more):
        """Return a primitive with positions in single precision and triangles."""
        positions = self.accessor(vertices.astype("<f4"))
        return {
            "attributes": {"POSITION": positions},
            "indices": self.accessor(faces.astype("<u2").ravel()),
        } | more

    def glb(self):
        document = self.document | {
            "buffers": [{"byteLength": len(self.data)}, *self.document["buffers"][1:]]
        }
        text = json.dumps(document).encode()
        text, data = text + b" " * (-len(text) % 4), self.data + b"\0" * (-len(self.data) % 4)
        chunks = (
            struct.pack("<I4s", len(text), b"JSON")
            + text
            + struct.pack("<I4s", len(data), b"BIN\0")
            + data
        )
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def read(self):
        return read_gltf(Source(Path("a.glb"), self.glb()))


def test_the_least_normalised_integer_is_minus_one():
    scene = Scene()
    stored = np.array([[-128, -127, 127], [0, 1, 2], [3, 4, 5]], dtype="i1")
    scene.node(
        mesh=scene.mesh(
            {"attributes": {"POSITION": scene.accessor(stored, normalized=True)}, "mode": 0}
        )
    )
    found = scene.read()
    np.testing.assert_allclose(found.vertices[0], [-1, -1, 1])
    assert not len(found.faces)


def test_nodes_move_what_is_below_them_and_mirrors_turn_faces_round(tmp_path):
    scene = Scene()
    mesh = scene.mesh(scene.plain())
    inner = scene.node(root=False, mesh=mesh, scale=[-1, 2, 3])
    middle = scene.node(root=False, children=[inner], rotation=QUARTER, translation=[1, 0, 0])
    matrix = np.array([[0, -2.0, 0, 5], [2, 0, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1]])
    scene.node(children=[middle], matrix=matrix.T.ravel().tolist())
    scene.node(mesh=mesh)
    found = scene.read()
    turned = MESH.vertices * [-1, 2, 3] @ QUARTER_TURN.T + [
        1,
        0,
        0,
    ]
    expected = turned @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(found.vertices, np.concatenate([expected, MESH.vertices]), atol=1e-5)
    np.testing.assert_array_equal(
        found.faces, np.concatenate([MESH.faces[:, ::-1], MESH.faces + 60])
    )
    (tmp_path / "a.glb").write_bytes(scene.glb())
    other = trimesh.load_scene(tmp_path / "a.glb", process=False).to_geometry()
    np.testing.assert_allclose(
        np.sort(other.area_faces), np.sort(np.linalg.norm(normals(found), axis=1) / 2), rtol=1e-4
    )
    np.testing.assert_allclose(
        other.volume, np.linalg.det(found.vertices[found.faces]).sum() / 6, rtol=1e-4
    )


def test_the_node_of_a_skinned_mesh_does_not_move_it_but_what_is_below_it():
    scene = Scene()
    mesh = scene.mesh(scene.plain())
    below = scene.node(root=False, mesh=mesh)
    skinned = scene.node(root=False, mesh=mesh, skin=0, scale=[1, 5, 1], children=[below])
    scene.node(children=[skinned], rotation=QUARTER, translation=[1, 0, 0])
    scene.document["skins"] = [{"joints": [scene.node()]}]
    found = scene.read()
    np.testing.assert_allclose(found.vertices[:60], MESH.vertices, atol=1e-6)
    moved = MESH.vertices * [1, 5, 1] @ QUARTER_TURN.T
    np.testing.assert_allclose(found.vertices[60:] - [1, 0, 0], moved, atol=1e-5)
    assert found.notes == not_kept(["the pose of its skeleton"])


def normals(raw):
    corners = raw.vertices[raw.faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_meshes_are_found_without_a_list_of_scenes():
    scene = Scene()
    below = scene.node(root=False, mesh=scene.mesh(scene.plain()))
    scene.node(children=[below], translation=[1, 2, 3])
    del scene.document["scenes"], scene.document["scene"]
    np.testing.assert_allclose(scene.read().vertices - [1, 2, 3], MESH.vertices, atol=1e-6)


def test_strips_fans_points_and_triangles_without_indices():
    scene = Scene()
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4")
    around = square[[0, 1, 3, 2]]
    primitives = [
        {"attributes": {"POSITION": scene.accessor(square)}, "mode": 5},
        {"attributes": {"POSITION": scene.accessor(around)}, "mode": 6},
        {"attributes": {"POSITION": scene.accessor(square[:3])}},
        {"attributes": {"POSITION": scene.accessor(square[:2])}, "mode": 1},
        {"attributes": {"POSITION": scene.accessor(square[3:])}, "mode": 0},
        {"attributes": {}},
    ]
    scene.node(mesh=scene.mesh(*primitives))
    found = scene.read()
    expected = [[0, 1, 2], [2, 1, 3], [4, 5, 6], [4, 6, 7], [8, 9, 10]]
    assert found.faces.tolist() == expected
    assert (normals(found)[:, 2] > 0).all()
    assert len(found.vertices) == 12
    assert found.notes == not_kept(["lines"])


def test_primitives_that_share_vertices_keep_their_numbers():
    scene = Scene()
    first = scene.plain(faces=MESH.faces[:40])
    second = first | {
        "indices": scene.accessor(MESH.faces[40:].astype("<u2").ravel()),
        "material": 0,
    }
    first["attributes"] = first["attributes"] | {"TEXCOORD_0": 0, "COLOR_0": 0}
    scene.node(mesh=scene.mesh(first, second))
    found = scene.read()
    assert len(found.vertices) == 60
    np.testing.assert_array_equal(found.faces, MESH.faces)
    assert found.notes == not_kept(["colours", "materials", "texture coordinates"])


@pytest.mark.parametrize("has_base", [True, False])
def test_sparse_accessors_replace_some_rows(has_base):
    scene = Scene()
    places, rows = np.array([3, 7, 50], dtype="<u2"), np.arange(9.0).reshape(3, 3).astype("<f4")
    primitive = scene.plain()
    accessor = scene.document["accessors"][primitive["attributes"]["POSITION"]]
    accessor["sparse"] = {
        "count": 3,
        "indices": {"bufferView": scene.view(places), "componentType": 5123},
        "values": {"bufferView": scene.view(rows)},
    }
    expected = MESH.vertices.copy() if has_base else np.zeros((60, 3))
    if not has_base:
        del accessor["bufferView"]
    expected[places] = rows
    scene.node(mesh=scene.mesh(primitive))
    np.testing.assert_allclose(scene.read().vertices, expected, atol=1e-6)
    accessor["sparse"]["count"] = 10**12
    with pytest.raises(InputError, match="go beyond the end"):
        scene.read()


def test_a_sparse_accessor_cannot_promise_more_than_its_file():
    scene = Scene()
    primitive = scene.plain()
    accessor = scene.document["accessors"][primitive["attributes"]["POSITION"]]
    del accessor["bufferView"]
    accessor["sparse"] = {
        "count": 1,
        "indices": {
            "bufferView": scene.view(np.zeros(1, dtype="<u2")),
            "componentType": 5123,
        },
        "values": {"bufferView": scene.view(np.ones((1, 3), dtype="<f4"))},
    }
    scene.node(mesh=scene.mesh(primitive))
    accessor["count"] = 1000
    assert len(scene.read().vertices) == 1000
    accessor["count"] = 10_000_000
    with most_memory(2**20), pytest.raises(InputError, match="all accessors in full"):
        scene.read()


def test_morph_targets_count_by_the_weights_of_the_node_or_mesh():
    scene = Scene()
    targets = [
        {"POSITION": scene.accessor(np.full((60, 3), shift, dtype="<f4"))} for shift in (1.0, 10.0)
    ]
    primitive = scene.plain(targets=targets)
    scene.node(mesh=scene.mesh(primitive, weights=[0.5, 0.0]))
    np.testing.assert_allclose(scene.read().vertices, MESH.vertices + 0.5, atol=1e-5)
    scene.document["nodes"][0]["weights"] = [0.0, 2.0]
    np.testing.assert_allclose(scene.read().vertices, MESH.vertices + 20, atol=1e-5)


@pytest.mark.parametrize(
    ("extension", "word"),
    [("KHR_draco_mesh_compression", "Draco"), ("EXT_meshopt_compression", "meshopt")],
)
def test_compressed_meshes_are_named_with_a_remedy(tmp_path, extension, word):
    scene = Scene()
    primitive = scene.plain()
    scene.node(mesh=scene.mesh(primitive))
    if word == "Draco":
        primitive["extensions"] = {extension: {"bufferView": 0, "attributes": {"POSITION": 0}}}
        for accessor in scene.document["accessors"]:
            del accessor["bufferView"]
    else:
        scene.document["buffers"].append(
            {"byteLength": 1000, "extensions": {extension: {"fallback": True}}}
        )
        for view in scene.document["bufferViews"]:
            view |= {"buffer": 1, "extensions": {extension: {"buffer": 0}}}
    (tmp_path / "a.glb").write_bytes(scene.glb())
    with pytest.raises(
        InputError, match=rf"a\.glb: is compressed with {word}, .* Export it without compression"
    ):
        read_shape(tmp_path / "a.glb")


def test_copies_on_the_graphics_card_are_refused_with_a_remedy():
    scene = Scene()
    scene.node(
        mesh=scene.mesh(scene.plain()), extensions={"EXT_mesh_gpu_instancing": {"attributes": {}}}
    )
    with pytest.raises(InputError, match="export it without instancing"):
        scene.read()


def gltf(folder, scene, uri):
    document = scene.document | {"buffers": [{"byteLength": len(scene.data), "uri": uri}]}
    (folder / "a.gltf").write_text(json.dumps(document))
    return folder / "a.gltf"


@pytest.fixture
def scene():
    one = Scene()
    one.node(mesh=one.mesh(one.plain()))
    return one


def test_gltf_files_hold_their_data_or_have_it_beside_them(tmp_path, scene):
    for uri in (
        "data:application/octet-stream;base64," + base64.b64encode(scene.data).decode(),
        "my%20data.bin",
    ):
        (tmp_path / "my data.bin").write_bytes(scene.data)
        shape = read_shape(gltf(tmp_path, scene, uri))
        np.testing.assert_allclose(shape.vertices, MESH.vertices, atol=1e-6)
        np.testing.assert_array_equal(shape.faces, MESH.faces)


def test_a_change_of_the_data_beside_a_gltf_file_is_noticed(tmp_path, scene):
    path = gltf(tmp_path, scene, "a.bin")
    (tmp_path / "a.bin").write_bytes(scene.data)
    before = hash_shape(path)
    assert read_source(path).digest == before
    read_shape(path, digest=before)
    (tmp_path / "a.bin").write_bytes(scene.data[:-2] + b"\1\0")
    assert hash_shape(path) != before
    with pytest.raises(UnavailableError, match="has changed since the run began"):
        read_shape(path, digest=before)


def test_data_that_is_missing_is_named_and_files_elsewhere_are_not_opened(tmp_path, scene):
    (tmp_path / "secret.bin").write_bytes(scene.data)
    (tmp_path / "shapes").mkdir()
    for uri in (
        "../secret.bin",
        str(tmp_path / "secret.bin"),
        "%2e%2e/secret.bin",
        "file:///secret.bin",
        "https://a.b/c",
        "dta:" + "A" * 5000,
    ):
        with pytest.raises(
            InputError, match=r"a\.gltf: names as its data no file of its own folder"
        ):
            read_shape(gltf(tmp_path / "shapes", scene, uri))
    with pytest.raises(UnavailableError, match=r"none\.bin: no such file"):
        read_shape(gltf(tmp_path / "shapes", scene, "none.bin"))


def test_files_that_end_early_or_are_of_old_versions_are_refused(scene):
    content = scene.glb()
    for wrong, reason in (
        (content[:-1], "truncated, its header promises"),
        (content[:4] + struct.pack("<I", 1) + content[8:], "GLB of version 1"),
        (
            content[:8] + struct.pack("<I", 20) + struct.pack("<I", 10**9) + content[16:],
            "a part of 1000000000 bytes",
        ),
    ):
        with pytest.raises(InputError, match=reason):
            read_gltf(Source(Path("a.glb"), wrong))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda d: d["accessors"][0].update(count=10**6), "go beyond the end"),
        (lambda d: d["accessors"][0].update(count=10**18), "go beyond the end"),
        (lambda d: d["accessors"][0].update(byteOffset=4), "go beyond the end"),
        (lambda d: d["bufferViews"][0].update(byteOffset=10**6), "go beyond the end"),
        (lambda d: d["accessors"][0].update(type="SCALAR"), "in a wrong place"),
        (lambda d: d["accessors"][1].update(count=4), "4 corners"),
        (lambda d: d["nodes"][0].update(mesh=-1), "number -1 of its meshes"),
        (lambda d: d["nodes"][0].update(children=[0]), "in two places"),
        (lambda d: d["scenes"][0].update(nodes=[0, 0]), "in two places"),
        (lambda d: d["scenes"][0].update(nodes=[5]), "number 5 of its nodes"),
        (lambda d: d["scenes"][0].update(nodes=[]), "holds no geometry"),
        (lambda d: d["bufferViews"][0].update(buffer=1), "number 1 of its buffers"),
        (lambda d: d["meshes"].__setitem__(0, 3), "is no entry"),
    ],
)
def test_what_is_not_there_is_refused(scene, change, reason):
    change(scene.document)
    with pytest.raises(InputError, match=reason):
        scene.read()


def test_faces_must_name_vertices(scene):
    scene.document["accessors"][0]["count"] = 10
    with pytest.raises(InputError, match=r"names vertex \d+, there are 10"):
        scene.read()


def test_instances_cannot_ask_for_any_memory():
    scene = Scene()
    many = scene.accessor(np.zeros((20_000, 3), dtype="<f4"))
    mesh = scene.mesh({"attributes": {"POSITION": many}, "mode": 0})
    for _ in range(1000):
        scene.node(mesh=mesh)
    with pytest.raises(InputError, match="fewer copies of its meshes"):
        scene.read()
