import io
import zipfile

import numpy as np
import pytest

from data_tools.errors import InputError
from data_tools.io.archives import load_array, load_arrays
from tests.memory import most_memory


def archive(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def with_header(shape, data, descr="'<f8'"):
    """An archive whose only array promises another shape or type than its data have."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        made.writestr("a.npy", npy(shape, data, descr))
    return stream.getvalue()


def npy(shape, data, descr="'<f8'"):
    """A NPY file of this header and data."""
    header = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header = header.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data


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


def test_a_bomb_is_refused_before_memory_is_taken():
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made,
        made.open("a.npy", "w", force_zip64=True) as member,
    ):
        member.write(b"\x93NUMPY\x01\x00")
        for _ in range(70):
            member.write(bytes(2**20))
    with most_memory(20 * 2**20), pytest.raises(InputError, match="save it without compression"):
        load_arrays(stream.getvalue(), "a.npz")


def test_an_array_that_is_all_alike_is_no_bomb():
    labels = np.zeros(8_000_000)
    np.testing.assert_array_equal(load_arrays(archive(labels=labels), "a")["labels"], labels)


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_other_compression_than_that_of_numpy_is_refused(method):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as made:
        made.writestr("a.npy", npy("(2,)", bytes(16)))
    with most_memory(2**20), pytest.raises(InputError, match="save it with"):
        load_arrays(stream.getvalue(), "a.npz")


@pytest.mark.parametrize(
    "content",
    [b"", b"no array at all", "npy", "npy-nested", b"\x93NUMPY\x01\x00\xff\xff{'shape'"],
)
def test_one_array_that_promises_the_world_is_refused(content):
    if content == "npy":
        content = npy(f"({2**48},)", bytes(16))
    elif content == "npy-nested":
        content = npy(f"({2**70}, 0)", b"")
    with most_memory(2**20), pytest.raises(InputError, match=r"a\.npy"):
        load_array(io.BytesIO(content), len(content), "a.npy")


@pytest.mark.parametrize("descr", ["'|O'", "'<U0'", "[('a', '|O')]", "'nonsense'"])
def test_objects_and_impossible_types_are_refused(descr):
    with pytest.raises(InputError, match=r"a\.npz"):
        load_arrays(with_header("(2,)", bytes(16), descr), "a.npz")


def test_damage_is_named():
    content = bytearray(archive(a=np.arange(1000)))
    content[60] ^= 255
    with pytest.raises(InputError, match=r"a\.npz: a.npy is damaged"):
        load_arrays(bytes(content), "a.npz")
