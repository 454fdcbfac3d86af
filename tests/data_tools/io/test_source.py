import json
from pathlib import Path

import pytest

from data_tools.errors import InputError
from data_tools.io.source import (
    DIGEST_LENGTH,
    MAX_FILE_BYTES,
    Room,
    Source,
    hash_source,
    read_source,
)
from tests.memory import most_memory


def test_files_are_hashed_by_content(tmp_path):
    for name, content in (("a.ply", b"1"), ("b.off", b"1"), ("c.ply", b"2")):
        (tmp_path / name).write_bytes(content)
    digests = [hash_source(tmp_path / name) for name in ("a.ply", "b.off", "c.ply")]
    assert digests[0] == digests[1] != digests[2]
    assert len(digests[0]) == DIGEST_LENGTH
    assert read_source(tmp_path / "c.ply").digest == digests[2]


@pytest.mark.parametrize("size", [0, 664, 10**6, 10**9])
def test_the_memory_of_a_file_grows_with_its_size_up_to_a_limit(size):
    most = min(64 * 2**20 + 64 * size, MAX_FILE_BYTES)
    Room("a.npz", size).take(most)
    with pytest.raises(InputError, match=r"a\.npz: promises .* unpack it"):
        Room("a.npz", size).take(most + 1, "unpack it")
    room = Room("a.npz", size)
    room.take(most - 1)
    room.take(1)
    with pytest.raises(InputError, match="save it without compression"):
        room.take(1)


def test_the_data_beside_a_file_count_as_the_file():
    source = Source(Path("a.gltf"), b"{}", companions={"a": bytes(10**6)})
    Room.of(source).take(2**26 + 64 * (10**6 + 2))
    with pytest.raises(InputError):
        Room.of(source).take(2**26 + 64 * (10**6 + 2) + 1)


def test_data_under_several_names_are_read_once(tmp_path):
    (tmp_path / "a.bin").write_bytes(bytes(2**20))
    names = ["a.bin", "./a.bin", ".//a.bin", "%61.bin", *("./" * n + "a.bin" for n in range(2, 90))]
    document = {"buffers": [{"uri": name, "byteLength": 2**20} for name in names]}
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    with most_memory(3 * 2**20):
        source = read_source(tmp_path / "a.gltf")
    assert set(source.companions) == set(names)
    assert {len(content) for content in source.companions.values()} == {2**20}
