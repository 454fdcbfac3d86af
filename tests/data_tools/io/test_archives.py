import io
import zipfile

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from tests.memory import most_memory


def archive(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def with_header(shape, data, descr="'<f8'"):
    """An archive whose only array promises another shape or type than its data have."""
    header = (
        f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117)
        + b"\n"
    )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        made.writestr(
            "a.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data
        )
    return stream.getvalue()


def test_arrays_of_all_kinds_come_back(rng):
    arrays = {
        "floats": rng.standard_normal((3, 4)),
        "fortran": np.asfortranarray(rng.standard_normal((3, 4))),
        "flags": np.array([True, False]),
        "text": np.array(["a", "bc"]),
        "number": np.array(3),
        "empty": np.empty((0, 3)),
    }
    loaded = load_arrays(archive(**arrays), "a.npz")
    assert loaded.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(loaded[name], array)
        assert loaded[name].dtype == array.dtype
        assert loaded[name].flags.writeable
    np.testing.assert_array_equal(load_arrays(with_header("(2,)", bytes(16)), "a")["a"], [0.0, 0.0])


def test_a_bomb_is_refused_before_memory_is_taken(monkeypatch):
    monkeypatch.setattr("data_tools.io.archives.MAX_FILE_BYTES", 2**26)
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made,
        made.open("a.npy", "w", force_zip64=True) as member,
    ):
        member.write(b"\x93NUMPY\x01\x00")
        for _ in range(70):
            member.write(bytes(2**20))
    with most_memory(20 * 2**20), pytest.raises(InputError, match="unpacks to"):
        load_arrays(stream.getvalue(), "a.npz")


def test_many_arrays_count_together(monkeypatch):
    content = archive(a=np.zeros(1000), b=np.zeros(1000))
    load_arrays(content, "a.npz")
    monkeypatch.setattr("data_tools.io.archives.MAX_FILE_BYTES", 10_000)
    with pytest.raises(InputError, match="unpacks to"):
        load_arrays(content, "a.npz")


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(3,)", "(1,)", "(-2,)", "(2.5,)", "'x'"])
def test_a_header_that_promises_other_bytes_is_refused(shape):
    with pytest.raises(InputError, match=r"a\.npz"):
        load_arrays(with_header(shape, bytes(16)), "a.npz")


@pytest.mark.parametrize("descr", ["'|O'", "'<U0'", "[('a', '|O')]", "'nonsense'"])
def test_objects_and_impossible_types_are_refused(descr):
    with pytest.raises(InputError, match=r"a\.npz"):
        load_arrays(with_header("(2,)", bytes(16), descr), "a.npz")


def test_damage_is_named():
    content = bytearray(archive(a=np.arange(1000)))
    content[60] ^= 255
    with pytest.raises(InputError, match=r"a\.npz: damaged"):
        load_arrays(bytes(content), "a.npz")
