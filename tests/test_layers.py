"""The three packages import only downwards, and heavy libraries only where they are used."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = {
    "data_tools": {"data_tools"},
    "pairwise": {"pairwise", "data_tools.errors", "data_tools.arrays", "data_tools.threads"},
    "collalign": {"collalign", "pairwise", "data_tools"},
}
HEAVY = {"trimesh", "cvxpy", "open3d", "matplotlib", "distributed", "clarabel", "scs"}


def imported_modules(tree: ast.AST, *, top_level_only: bool = False) -> set[str]:
    """Return the dotted names that a module imports."""
    found = set()
    nodes = ast.iter_child_nodes(tree) if top_level_only else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module)
    return found


def upward_imports(package: str, modules: set[str]) -> set[str]:
    """Return the imports of our own packages that ``package`` must not make."""
    ours = {m for m in modules if m.split(".")[0] in ALLOWED}
    allowed = ALLOWED[package]
    return {m for m in ours if m not in allowed and not any(m.startswith(a + ".") for a in allowed if "." not in a)}


def sources() -> list[tuple[str, Path]]:
    return [(p, f) for p in ALLOWED for f in sorted((ROOT / p).rglob("*.py"))]


@pytest.mark.parametrize(("package", "file"), sources(), ids=lambda v: getattr(v, "stem", v))
def test_imports_point_downwards(package: str, file: Path) -> None:
    assert not upward_imports(package, imported_modules(ast.parse(file.read_text("utf-8"))))


@pytest.mark.parametrize(("package", "file"), sources(), ids=lambda v: getattr(v, "stem", v))
def test_heavy_libraries_are_imported_where_they_are_used(package: str, file: Path) -> None:
    top = imported_modules(ast.parse(file.read_text("utf-8")), top_level_only=True)
    assert not {m for m in top if m.split(".")[0] in HEAVY}


def test_the_check_itself_sees_an_upward_import() -> None:
    modules = imported_modules(ast.parse("from collalign.align import align_collection\nimport numpy"))
    assert upward_imports("pairwise", modules) == {"collalign.align"}
    assert upward_imports("pairwise", {"data_tools.io.shapes"}) == {"data_tools.io.shapes"}
    assert not upward_imports("collalign", modules | {"data_tools.io.shapes", "pairwise"})
