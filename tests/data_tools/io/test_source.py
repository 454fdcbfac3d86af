import base64
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError, UnavailableError
from data_tools.io.shapes import read_shape
from data_tools.io.source import DIGEST_LENGTH, hash_source, read_source


@pytest.fixture
def gltf(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A GLTF file whose numbers lie in ``gltf_buffer_0.bin`` and so on."""
    shape = blob(rng, num_vertices=60)
    parts = trimesh.Trimesh(shape.vertices, shape.faces, process=False).export(file_type="gltf")
    for name, content in parts.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path / "model.gltf"


def buffers(gltf: Path) -> list[Path]:
    return [gltf.parent / entry["uri"] for entry in json.loads(gltf.read_text())["buffers"]]


def test_files_are_hashed_by_content(tmp_path: Path) -> None:
    for name, content in (("a.ply", b"1"), ("b.off", b"1"), ("c.ply", b"2")):
        (tmp_path / name).write_bytes(content)
    digests = [hash_source(tmp_path / name) for name in ("a.ply", "b.off", "c.ply")]
    assert digests[0] == digests[1] != digests[2]
    assert len(digests[0]) == DIGEST_LENGTH
    assert read_source(tmp_path / "c.ply").digest == digests[2]


def test_the_buffers_of_a_gltf_file_are_its_content(gltf: Path) -> None:
    read_shape(gltf)
    whole = hash_source(gltf)
    assert read_source(gltf).digest == whole
    buffer = buffers(gltf)[0]
    content = buffer.read_bytes()
    buffer.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert len({whole, hash_source(gltf), read_source(gltf).digest}) == 2
    buffer.unlink()
    missing = hash_source(gltf)
    assert missing == read_source(gltf).digest != whole
    with pytest.raises(UnavailableError, match=buffer.name):
        read_shape(gltf)
    buffer.write_bytes(content)
    assert hash_source(gltf) == whole


def test_a_file_that_changes_while_it_is_read_keeps_the_digest_of_what_was_read(gltf: Path) -> None:
    source, before = read_source(gltf), hash_source(gltf)
    assert source.digest == before
    buffers(gltf)[0].write_bytes(b"something else")
    gltf.write_text("{}")
    assert source.digest == before != hash_source(gltf)


def test_a_shape_of_another_digest_is_refused(gltf: Path) -> None:
    digest = hash_source(gltf)
    assert read_shape(gltf, digest=digest).is_mesh
    with pytest.raises(UnavailableError, match="has changed"):
        read_shape(gltf, digest=digest[::-1])


def test_buffers_inside_the_text_are_no_files(gltf: Path) -> None:
    tree = json.loads(gltf.read_text())
    for entry, path in zip(tree["buffers"], buffers(gltf), strict=True):
        entry["uri"] = "data:application/octet-stream;base64," + base64.b64encode(path.read_bytes()).decode()
        path.unlink()
    gltf.write_text(json.dumps(tree))
    assert read_shape(gltf).is_mesh
    assert read_source(gltf).buffers == ()


@pytest.mark.parametrize("uri", ["../secret", "/etc/hostname", "a\x00b", "."])
def test_buffers_elsewhere_are_not_opened(tmp_path: Path, gltf: Path, uri: str) -> None:
    tree = json.loads(gltf.read_text())
    tree["buffers"][0]["uri"] = uri
    gltf.write_text(json.dumps(tree))
    assert hash_source(gltf) == read_source(gltf).digest
    with pytest.raises(InputError, match=r"model\.gltf"):
        read_shape(gltf)


@pytest.mark.parametrize("text", ["", "[", "[]", '{"buffers": 3}', '{"buffers": [3]}', '{"buffers": [{"uri": 3}]}'])
def test_damaged_gltf_files_have_a_digest_too(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(text or "{}")
    assert hash_source(path) == read_source(path).digest
    with pytest.raises(InputError):
        read_shape(path)
