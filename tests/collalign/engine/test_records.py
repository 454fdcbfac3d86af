import struct

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collalign.engine.records import decode, encode
from data_tools.errors import StoreError

PLAIN = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text()
)


def array_bytes(code, shape, raw):
    body = struct.pack(f"<BB{len(shape)}Q", code, len(shape), *shape) + raw
    return msgpack.packb({"a": msgpack.ExtType(1, body)})


@given(st.dictionaries(st.text(), PLAIN | st.binary() | st.lists(PLAIN)))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_plain_values_come_back(record):
    assert decode(encode(record), "x") == record


@pytest.mark.parametrize("dtype", ["f8", "f4", "i8", "i4", "u1", "?"])
@pytest.mark.parametrize("shape", [(), (0,), (3,), (0, 3), (2, 3, 4)])
def test_arrays_come_back_read_only(dtype, shape, rng):
    array = rng.integers(0, 2, shape).astype(dtype)
    back = decode(encode({"a": array}), "x")["a"]
    assert back.dtype == array.dtype
    assert back.shape == shape
    assert (back == array).all()
    assert not back.flags.writeable
    assert back.flags.c_contiguous


def test_special_floats_keep_their_bits():
    array = np.array([np.nan, -0.0, np.inf, 5e-324])
    assert decode(encode({"a": array}), "x")["a"].tobytes() == array.tobytes()


def test_bytes_depend_neither_on_order_of_keys_nor_on_layout(rng):
    matrix = rng.standard_normal((4, 5))
    one = encode({"a": matrix, "b": {"x": 1, "y": (2, 3)}})
    other = encode({"b": {"y": [2, 3], "x": np.int64(1)}, "a": np.asfortranarray(matrix)})
    assert one == other


@pytest.mark.parametrize(
    "value",
    [
        {"a": object()},
        {"a": {1: 2}},
        {"a": 1j},
        {"a": np.array(["x"])},
        {"a": np.array([None])},
        [1],
    ],
)
def test_what_a_record_cannot_hold_is_refused(value):
    with pytest.raises(TypeError):
        encode(value)


def test_deep_nesting_is_refused_both_ways():
    deep = 1
    for _ in range(10):
        deep = [deep]
    with pytest.raises(TypeError, match="nested"):
        encode({"a": deep})
    with pytest.raises(StoreError, match="nested"):
        decode(msgpack.packb({"a": deep}), "x")


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "not a record"),
        (b"\x93\x01\x02\x03", "not a record but list"),
        (encode({"a": 1}) + b"x", "not a record"),
        (encode({"a": np.zeros(4)})[:-1], "not a record"),
        (msgpack.packb({1: 2}), "not a record"),
        (msgpack.packb({"a": msgpack.Timestamp(1)}), "holds a Timestamp"),
        (msgpack.packb({"a": msgpack.ExtType(2, b"x")}), "extension 2"),
        (array_bytes(9, (1,), b"\0" * 8), "type 9"),
        (array_bytes(0, (2,), b"\0" * 8), "8 bytes for an array"),
        (array_bytes(0, (2**40, 0), b""), "for an array"),
        (array_bytes(0, (1, 1, 1, 1, 1), b"\0" * 8), "5 dimensions"),
        (array_bytes(5, (1,), b"\x02"), "boolean"),
        (b"\xdd\xff\xff\xff\xff", "not a record"),
        (b"\x81" * 600, "not a record"),
    ],
)
def test_malformed_bytes_are_refused(data, reason):
    with pytest.raises(StoreError, match=reason):
        decode(data, "pair 7")
