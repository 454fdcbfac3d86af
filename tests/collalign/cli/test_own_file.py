import json
import os

import numpy as np
import pytest

from collalign.cli.own_file import read_own
from data_tools.errors import InputError
from tests.memory import most_memory


def own_file(folder, **content):
    path = folder / "own.json"
    path.write_text(json.dumps(content))
    return path


def npy(shape):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117)
    return b"\x93NUMPY\x01\x00\x76\x00" + header + b"\n"


def test_invariants_are_found_under_the_names_of_the_shapes(tmp_path, rng):
    folder, values = tmp_path / "values", rng.random((2, 4, 3))
    (folder / "left").mkdir(parents=True)
    np.save(folder / "left" / "a.npy", values[0])
    np.save(folder / "e\u0301.npy", values[1])  # an accent apart, as some systems store it
    (folder / "of nobody.npy").write_bytes(b"is not opened")
    own, inputs = read_own(own_file(tmp_path, invariants="values"), ["left/a", "é", "b"])
    assert inputs == {tmp_path / "own.json", folder}
    assert own.invariants.keys() == {"left/a", "é"}
    np.testing.assert_array_equal(own.invariants["left/a"], values[0])
    np.testing.assert_array_equal(own.invariants["é"], values[1])


@pytest.mark.parametrize("shape", [f"({2**48},)", f"({2**70}, 0)", "(3,)", "'x'"])
def test_an_array_that_promises_more_than_it_holds_is_refused(tmp_path, shape):
    (tmp_path / "a.npy").write_bytes(npy(shape))
    path = own_file(tmp_path, invariants=".")
    with most_memory(2**21), pytest.raises(InputError, match=r"own\.json: invariants: .*a\.npy"):
        read_own(path, ["a"])


def test_a_pickle_and_a_pipe_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}]), allow_pickle=True)
    os.mkfifo(tmp_path / "b.npy")
    for name, reason in (("a", "never read"), ("b", "not a regular file")):
        with pytest.raises(InputError, match=reason):
            read_own(own_file(tmp_path, invariants="."), [name])


def test_a_folder_is_not_searched(tmp_path, monkeypatch):
    monkeypatch.setattr("pathlib.Path.rglob", lambda *_: pytest.fail("searches all below"))
    for place in ("/", "nowhere", "."):
        with pytest.raises(InputError, match=r"holds no NAME\.npy of a shape"):
            read_own(own_file(tmp_path, invariants=place), ["a", "b"])


@pytest.mark.parametrize("text", ["{", "[" * 100_000, "9" * 10_000, "[1]"])
def test_what_is_no_json_of_knowledge_is_refused(tmp_path, text):
    (tmp_path / "own.json").write_text(text)
    with pytest.raises(InputError, match=r"own\.json: .*JSON"):
        read_own(tmp_path / "own.json", ["a"])


@pytest.mark.parametrize("place", [3, [], {"a": 1}, True, "a\0b"])
def test_what_names_no_folder_is_refused(tmp_path, place):
    with pytest.raises(InputError, match=r"own\.json: "):
        read_own(own_file(tmp_path, invariants=place), ["a"])
