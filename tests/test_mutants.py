"""Drawn faults fit the code, and the runner tells killed ones from survivors."""

import ast
import subprocess
import sys
from pathlib import Path

from tests.mutants.draw import Imports, as_mutant, by_package, changes, draw
from tests.mutants.equivalent import EQUIVALENT
from tests.mutants.place import MODULE

ROOT = Path(__file__).resolve().parents[1]
SOURCE = """LIMIT = 3


class Box:
    def holds(self, n):
        return n <= LIMIT


def twice(n):
    return n + n
"""


def fault(file, source, old, new, tests=()):
    """Return the fault that puts another text in the place of one that can be changed."""
    (found,) = {
        one for one in changes(source) if (source[one.start : one.end], one.new) == (old, new)
    }
    return as_mutant(file, source, found, tests)


def test_drawn_faults_depend_on_the_seed_alone_and_can_be_put_into_the_code():
    drawn = draw(ROOT, 40, 7)
    assert drawn == draw(ROOT, 40, 7)
    assert not set(map(str, drawn)) & set(map(str, draw(ROOT, 40, 8)))
    assert len({mutant.file for mutant in drawn}) > 25
    for mutant in drawn:
        text = (ROOT / mutant.file).read_text("utf-8")
        assert ast.dump(ast.parse(mutant.changed)) != ast.dump(ast.parse(text)), mutant
        assert mutant.old in text
        assert mutant.new in mutant.changed
        assert mutant.tests
        assert all((ROOT / test).is_file() for test in mutant.tests)
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
    assert found >= {
        ("3", "4"),
        ("not", ""),
        ("-", ""),
        ("1.5", "3.0"),
        ("items.clear()", "pass"),
        ("True", "False"),
    }
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


def test_a_fault_is_in_one_function_and_named_by_its_lines():
    found = [str(as_mutant("box.py", SOURCE, change)) for change in changes(SOURCE)]
    assert "box.py Box.holds: '        return n <= LIMIT' -> '        return n < LIMIT'" in found
    assert f"box.py {MODULE}: 'LIMIT = 3' -> 'LIMIT = 4'" in found
    source = "def f(a):\n    a += 1\n    a.call(\n        1,\n    )\n"
    two = [as_mutant("a.py", source, change) for change in changes(source) if change.new == "pass"]
    assert [(one.line, one.old.count("\n"), one.new) for one in two] == [
        (1, 0, "    pass"),
        (2, 2, "    pass"),
    ]
    assert [one.changed.count("\n") for one in two] == [5, 3]


def test_the_tests_of_a_module_come_before_those_of_its_users():
    tests = Imports(ROOT).tests_of("data_tools/rotations.py")
    assert "tests/data_tools/test_rotations.py" in tests
    assert "tests/pairwise/test_matching.py" in tests
    assert Imports(ROOT).tests_of("collalign/cli/certify.py")


def test_killed_ones_are_counted_by_package():
    a, b = (fault(file, SOURCE, "3", "4") for file in ("pairwise/a.py", "collalign/b.py"))
    counts = by_package([(a, "killed"), (a, "survived"), (b, "no verdict")])
    assert counts == {"collalign": (0, 0), "data_tools": (0, 0), "pairwise": (1, 2)}


def test_the_runner_tells_killed_from_survived_and_from_tests_that_fail_anyway(tmp_path):
    (tmp_path / "pyproject.toml").write_text(
        "[tool.pytest.ini_options]\nmarkers = ['data: needs data']\n"
    )
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
    faults = {"good": ("<=", "<"), "blind": ("+", "-"), "broken": ("+", "-"), "slow": ("3", "4")}
    mutants = [
        fault("tests/box.py", SOURCE, *faults[name], (f"tests/test_{name}.py",)) for name in names
    ]
    script = "\n".join(
        [
            "from pathlib import Path",
            "from tests.mutants.place import Mutant",
            "from tests.mutants import runner",
            "runner._LIBRARIES = ()",  # these tests need none
            f"for verdict in runner.run_mutants({mutants!r}, Path({str(tmp_path)!r}), time_limit_s=5):",
            "    print(verdict.ending)",
        ]
    )
    found = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert found.stdout.split("\n")[:4] == ["killed", "survived", "no verdict", "killed"]
    assert (folder / "box.py").read_text() == SOURCE
