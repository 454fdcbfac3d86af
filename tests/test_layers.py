"""Modules import as ``[tool.importlinter]`` of pyproject.toml allows, in no circle; folders and names stay plain."""

import ast
import subprocess
import sys
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data_tools", "pairwise", "collalign")
#: Modules a folder may hold, its own ``__init__`` not counted.
MOST_MODULES = 16
#: Stems that every tool may have.
TOOL_STEMS = ("run", "files", "command", "result")
#: Says the unit, not a choice.
HALF_TURN_DEG = 180.0


def sources(*packages):
    """Return the modules of packages, of all three by default, each with the name of its package."""
    return [(p, f) for p in packages or PACKAGES for f in sorted((ROOT / p).rglob("*.py"))]


def test_modules_import_only_what_their_room_may():
    """In a process of its own, since import-linter sets up logging anew."""
    command = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True, no_logo=True))"
    done = subprocess.run(
        [sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_modules_import_each_other_in_a_circle():
    """Imports inside functions count, since they only hide a circle; those for type checkers alone do not."""
    import grimp

    graph = grimp.build_graph(*PACKAGES, exclude_type_checking_imports=True, cache_dir=None)
    assert graph.count_imports() > 1000
    TopologicalSorter(
        {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    ).prepare()


def overfull(modules):
    """Return the folders that hold too many of the modules, given as paths."""
    counts = Counter(
        path.rpartition("/")[0] for path in modules if not path.endswith("__init__.py")
    )
    return {folder: num for folder, num in counts.items() if num > MOST_MODULES}


def repeated_stems(paths):
    """Return the stems of modules that a package has more than once, those that tools share set aside."""
    own = [
        p
        for p in paths
        if not p.endswith("__init__.py") and not ("/tools/" in p and Path(p).stem in TOOL_STEMS)
    ]
    return sorted(stem for stem, count in Counter(Path(p).stem for p in own).items() if count > 1)


def test_no_folder_is_a_warehouse():
    assert not overfull(
        file.relative_to(ROOT).as_posix() for _, file in sources(*PACKAGES, "experiments")
    )
    assert overfull(
        [*(f"a/b/m{i}.py" for i in range(17)), *(f"a/m{i}.py" for i in range(16)), "a/__init__.py"]
    ) == {"a/b": 17}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_file_name_says_where_it_is(package):
    assert repeated_stems([file.relative_to(ROOT).as_posix() for _, file in sources(package)]) == []
    assert repeated_stems(
        ["a/poses.py", "a/b/poses.py", "a/tools/x/run.py", "a/tools/y/run.py"]
    ) == ["poses"]


def unnamed_numbers(source):
    """Numbers inside functions that are neither small integers, nor halves of them, nor guards against rounding."""
    functions = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef)]
    numbers = {n for f in functions for n in ast.walk(f) if isinstance(n, ast.Constant)}
    values = [
        n.value
        for n in numbers
        if isinstance(n.value, int | float) and not isinstance(n.value, bool)
    ]
    return sorted(
        v
        for v in values
        if 1e-6 < v < 1e12 and (v > 9 or 2 * v != int(2 * v)) and v != HALF_TURN_DEG
    )


@pytest.mark.parametrize(
    "room", ["synchronization", "stages", "registration", "template_landmarks"]
)
def test_the_numbers_of_estimators_have_names(room):
    for path in (ROOT / "collalign" / room).rglob("*.py"):
        assert unnamed_numbers(path.read_text("utf-8")) == [], path
    code = "LIMIT = 60\ndef f(x, tol=0.3):\n    return 1.5 * x + 1e-12 if x < 12 else 2"
    assert unnamed_numbers(code) == [0.3, 12]
