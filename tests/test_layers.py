"""Modules import as ``[tool.importlinter]`` of pyproject.toml allows, in no circle."""

import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("data_tools", "pairwise", "collalign")


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
