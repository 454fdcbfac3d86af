from pathlib import Path

import pytest

from data_tools.errors import InputError
from data_tools.io.files import (
    existing_file,
    natural_key,
    read_toml,
    readable_name,
    readable_stem,
    write_atomic,
)

#: A control character of each kind that a name may hold: of terminals, of lines, of direction, and invisible ones.
CONTROLS = (
    "\x00\x1b\x7f\x9b\u061c\u200b\u200e\u200f\u2028\u2029\u202e\u2067\u2069\u2060\ufeff\U000e0041"
)


def test_natural_order_counts_numbers():
    names = ["tooth10", "Tooth2", "tooth1", "a", "tooth02b", "10", "9"]
    assert sorted(names, key=natural_key) == [
        "9",
        "10",
        "a",
        "tooth1",
        "Tooth2",
        "tooth02b",
        "tooth10",
    ]


def test_natural_order_is_total_for_digits_that_are_no_decimals():
    assert sorted(["a²", "a2", "a"], key=natural_key)[0] == "a"


def test_atomic_write_makes_folders_and_leaves_no_temporary_file(tmp_path):
    path = write_atomic(tmp_path / "new" / "file.bin", b"one")
    write_atomic(path, b"two")
    assert path.read_bytes() == b"two"
    assert [p.name for p in path.parent.iterdir()] == ["file.bin"]


def test_failed_atomic_write_keeps_the_old_file(tmp_path):
    path = write_atomic(tmp_path / "file.bin", b"old")
    with pytest.raises(TypeError):
        write_atomic(path, "text")
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("control", CONTROLS, ids=ascii)
def test_control_characters_in_names_and_messages_are_escaped(control):
    path = Path(f"a{control}ylp.ply")
    assert readable_name(path) == f"a{ascii(control)[1:-1]}ylp.ply"
    assert readable_stem(path) == f"a{ascii(control)[1:-1]}ylp"
    assert control not in str(InputError(f"{path}: damaged"))


@pytest.mark.parametrize("name", ["نمونه\u200cها", "שן", "👩\u200d🔬", "é ü", "歯 1"])
def test_names_in_any_script_stay_as_they_are(name):
    assert readable_stem(Path(f"{name}.ply")) == name


def test_existing_file_refuses_missing_folder_and_empty(tmp_path):
    (tmp_path / "empty").touch()
    for name, reason in (("missing", "no such file"), ("empty", "empty"), (".", "not a file")):
        with pytest.raises(InputError, match=reason):
            existing_file(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("a = ", "not TOML"),
        ("a = " + "9" * 10_000, "a number in it is too long"),
        ("a = " + "[" * 100_000, "nested"),
        ("[" + "a." * 500 + "a]", "nested"),
    ],
)
def test_what_is_no_configuration_is_refused(content, reason, tmp_path):
    (tmp_path / "good.toml").write_text("[a.b]\nc = [1, 2]\n")
    assert read_toml(tmp_path / "good.toml") == {"a": {"b": {"c": [1, 2]}}}
    (tmp_path / "bad.toml").write_text(content)
    with pytest.raises(InputError, match=reason):
        read_toml(tmp_path / "bad.toml")
