import pytest

from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import UnavailableError
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.io.source import DIGEST_LENGTH, hash_source, read_source


def test_files_are_hashed_by_content(tmp_path):
    for name, content in (("a.ply", b"1"), ("b.off", b"1"), ("c.ply", b"2")):
        (tmp_path / name).write_bytes(content)
    digests = [hash_source(tmp_path / name) for name in ("a.ply", "b.off", "c.ply")]
    assert digests[0] == digests[1] != digests[2]
    assert len(digests[0]) == DIGEST_LENGTH
    assert read_source(tmp_path / "c.ply").digest == digests[2]


def test_a_file_that_changes_while_it_is_read_keeps_the_digest_of_what_was_read(tmp_path):
    path = tmp_path / "a.ply"
    path.write_bytes(b"before")
    source, before = read_source(path), hash_source(path)
    path.write_bytes(b"after")
    assert source.digest == before != hash_source(path)


def test_a_shape_of_another_digest_is_refused(tmp_path, rng):
    path = write_mesh(tmp_path / "a.ply", blob(rng, num_vertices=60))
    digest = hash_source(path)
    assert read_shape(path, digest=digest).is_mesh
    with pytest.raises(UnavailableError, match="has changed"):
        read_shape(path, digest=digest[::-1])
