"""Damaged and hostile files: each is read or refused in words, by a process of little memory and time."""

import os
import re
import sys

import pytest
from hypothesis import given

from data_tools.errors import InputError
from tests.fuzz import targets
from tests.fuzz.confined import confined
from tests.fuzz.damage import FACTOR, MARK, damaged, fuzzing
from tests.fuzz.hostile_files import cases

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits on memory need Linux")

#: How many files of each kind are damaged in the suite.
NUMBERS = {
    "shapes": 60,
    "landmarks": 25,
    "stores": 30,
    "records": 30,
    "certificate-files": 20,
    "configs": 10,
}
CASES = cases()
GOOD = ("valid", "refused")


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    return targets.kinds(tmp_path_factory.mktemp("kinds"))


def test_the_undamaged_files_are_good(kinds):
    for target, files in (kinds[kind] for kind in NUMBERS if kind != "configs"):
        assert files
        assert all(target(item) >= 0 for item in files.items())
    with pytest.raises(InputError, match="holds no shape file"):  # and not that an option is wrong
        targets.read_config(("a.toml", kinds["configs"][1]["a.toml"]))


@pytest.mark.parametrize("kind", NUMBERS)
def test_damaged_files_end_in_a_clear_error_or_a_value(kinds, kind):
    target, files = kinds[kind]
    endings, changed = set(), []

    @fuzzing(NUMBERS[kind])
    @given(damaged(files))
    def read(item):
        ending = confined(target, item)
        assert ending in GOOD
        endings.add(ending)
        changed.append(item[1] != files[item[0]])

    read()
    assert endings == ({"refused"} if kind == "configs" else {*GOOD})
    assert sum(changed) > 0.7 * len(changed)


@pytest.mark.parametrize("name", sorted(CASES)[:: 3 if FACTOR == 1 else 1])
def test_hostile_files_are_read_or_refused(name):
    target, make = CASES[name]
    assert confined(target, make()) in GOOD


def refuse(reason):
    raise InputError(reason)


#: Targets that are not confined enough, and how each is to end.
ENDINGS = {
    "unclear error: ": [lambda _: {}["a"], lambda _: bytes(3 * 2**30)],
    "undecided: no answer": [lambda _: re.match(r"(a|a)*b", "a" * 60)],
    "undecided: killed by signal 9": [lambda _: os.kill(os.getpid(), 9)],
    "names internals: ": [lambda _: refuse("not read: IndexError")],
    "refused": [lambda _: refuse("is damaged")],
    "valid": [len],
}


@pytest.mark.parametrize(("wanted", "them"), ENDINGS.items(), ids=ENDINGS)
def test_bad_endings_are_noticed(wanted, them):
    for target in them:
        ending = confined(target, ("a.ply", b""), time_s=1)
        assert ending.startswith(wanted)
        assert (ending in GOOD) == (wanted in GOOD)


@pytest.mark.parametrize("message", [f"not a number: {MARK}", "UnboundLocalError"])
def test_reasons_that_quote_the_file_or_name_internals_are_noticed(message):
    with pytest.raises(RuntimeError, match="quotes the file"):
        targets.read_and_sample(("a.ply", MARK.encode()), lambda path: refuse(message))
