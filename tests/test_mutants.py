"""Drawn faults fit the code, and the runner tells killed ones from survivors."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutants.calls import Calls
from tests.mutants.draw import Imports, as_mutant, by_package, changes, draw
from tests.mutants.equivalent import EQUIVALENT
from tests.mutants.place import MODULE, Mutant, applied, mutated

ROOT = Path(__file__).resolve().parents[1]
SOURCE = """LIMIT = 3


class Box:
    def holds(self, n):
        return n <= LIMIT


def twice(n):
    return n + n
"""


def is_there(mutant):
    try:
        applied(mutant, ROOT)
    except ValueError:
        return False
    return bool(mutant.tests) and all((ROOT / test).is_file() for test in mutant.tests)


def fault(function, old, new, tests=()):
    return Mutant("box.py", function, old, new, tests)


def test_faults_are_put_into_one_function_only():
    assert "return n < LIMIT" in mutated(SOURCE, fault("Box.holds", "<=", "<"))
    assert mutated(SOURCE, fault(MODULE, "3", "4")).startswith("LIMIT = 4")
    assert mutated(SOURCE, fault("twice", "n + n", "n")).endswith("return n\n")


@pytest.mark.parametrize(
    ("function", "old", "new", "message"),
    [
        ("thrice", "n", "m", "no such function"),
        ("twice", "LIMIT", "4", "occurs 0 times"),
        ("twice", "n + n", "(n + n)", "changes nothing"),
        (MODULE, "LIMIT)", "", "occurs 0 times"),
    ],
)
def test_faults_that_are_none_are_refused(function, old, new, message):
    with pytest.raises(ValueError, match=message):
        mutated(SOURCE, fault(function, old, new))


def test_drawn_faults_depend_on_the_seed_alone_and_can_be_put_into_the_code():
    drawn = draw(ROOT, 40, 7)
    assert drawn == draw(ROOT, 40, 7)
    assert not set(map(str, drawn)) & set(map(str, draw(ROOT, 40, 8)))
    assert len({mutant.file for mutant in drawn}) > 25
    assert not [str(mutant) for mutant in drawn if not is_there(mutant)]
    assert all(EQUIVALENT.values())


def test_every_operator_number_and_condition_is_a_place():
    source = """def grow(items: list[int] | None, most=3):
    if not items:
        return -1.5
    items.clear()
    while True:
        if (len(items) + 1) < most and max(items) in (2, 0.0):
            break
    return f"{1 + 1}"
"""
    found = {(source[one.start : one.end], one.new) for one in changes(source)}
    assert found >= {("3", "4"), ("not", ""), ("-", ""), ("1.5", "3.0"), ("items.clear()", "pass"), ("True", "False")}
    assert found >= {
        ("+", "-"),
        ("<", "<="),
        ("and", "or"),
        ("max", "min"),
        ("in", "not in"),
        ("2", "3"),
        ("0.0", "1.0"),
    }
    assert ("not items", "not (not items)") in found
    assert ("break", "pass") in found
    assert sum(new == "-" for _, new in found) == 1, "texts and annotations have none"


def test_a_drawn_fault_names_lines_that_are_found_again():
    source = "def f(a):\n    a += 1\n    a += 1\n    return a\n"
    seen = set()
    for change in changes(source):
        mutant = as_mutant(source, change)
        assert mutant.function == "f"
        changed = mutated(source, mutant)
        assert changed == source[: change.start] + change.new + source[change.end :]
        seen.add(changed)
    assert len(seen) == 4


def test_the_tests_of_a_module_come_before_those_of_its_users():
    tests = Imports(ROOT).tests_of("data_tools/rotations.py")
    assert "tests/data_tools/test_rotations.py" in tests
    assert "tests/pairwise/test_matching.py" in tests
    assert Imports(ROOT).tests_of("collalign/cli/certify.py")


def test_a_fault_is_shown_to_the_tests_that_call_what_it_changes(tmp_path):
    (tmp_path / "collalign").mkdir()
    (tmp_path / "collalign" / "__init__.py").write_text("")
    (tmp_path / "collalign" / "box.py").write_text(
        "LIMIT = 3\n\n\ndef small(n):\n    return n < LIMIT\n\n\ndef other():\n    pass\n"
    )
    tests = """import sys
import pytest
sys.path.insert(0, '.')
from collalign.box import other, small

@pytest.fixture(scope='module')
def found():
    return small(2)

def test_first(found): assert found
def test_second(found): assert found
def test_neither(): other()
def test_failing(): assert small(3)
"""
    (tmp_path / "test_box.py").write_text(tests)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MUTANTS_CALLS": str(tmp_path), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.mutants.calls", "test_box.py"]
    subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, check=False)
    calls = Calls(tmp_path, tmp_path)
    names = tuple(f"test_box.py::test_{name}" for name in ("first", "second"))
    for function, old, new in (("small", "<", "<="), (MODULE, "3", "4")):
        mutant = Mutant("collalign/box.py", function, old, new, ())
        assert sorted(calls.tests_of(mutant, ())) == sorted(names)
    assert not calls.tests_of(Mutant("collalign/box.py", "unheard", "1", "2", ()), ())


def test_killed_ones_are_counted_by_package():
    a, b = Mutant("pairwise/a.py", "f", "1", "2", ()), Mutant("collalign/b.py", "f", "1", "2", ())
    counts = by_package([(a, "killed"), (a, "survived"), (b, "no verdict")])
    assert counts == {"collalign": (0, 0), "data_tools": (0, 0), "pairwise": (1, 2)}


def test_the_runner_tells_killed_from_survived_and_from_tests_that_fail_anyway(tmp_path):
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\nmarkers = ['data: needs data']\n")
    folder = tmp_path / "tests"
    folder.mkdir()
    (folder / "box.py").write_text(SOURCE)
    names = ("good", "blind", "broken", "slow")
    bodies = {
        "good": "assert box.Box().holds(3)",
        "blind": "assert box.twice(0) == 0",
        "broken": "assert False",
        "slow": "import time; time.sleep(0 if box.LIMIT == 3 else 60)",
    }
    loader = (
        "import importlib.util, pathlib\n"
        "spec = importlib.util.spec_from_file_location('box', pathlib.Path(__file__).parent / 'box.py')\n"
        "box = importlib.util.module_from_spec(spec)\nspec.loader.exec_module(box)\n"
    )
    for name in names:
        (folder / f"test_{name}.py").write_text(f"{loader}\n\ndef test_it():\n    {bodies[name]}\n")
    changes = {"good": ("Box.holds", "<=", "<"), "blind": ("twice", "n + n", "n"), "broken": ("twice", "n + n", "n")}
    changes["slow"] = (MODULE, "3", "4")
    mutants = [Mutant("tests/box.py", *changes[name], (f"tests/test_{name}.py",)) for name in names]
    script = "\n".join(
        [
            "from pathlib import Path",
            "from tests.mutants.place import Mutant",
            "from tests.mutants.runner import run_mutants",
            f"for verdict in run_mutants({mutants!r}, Path({str(tmp_path)!r}), time_limit_s=5):",
            "    print(verdict.ending)",
        ]
    )
    found = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.split("\n")[:4] == ["killed", "survived", "no verdict", "killed"]
    assert (folder / "box.py").read_text() == SOURCE
