"""The three packages import only downwards, and heavy libraries only where they are used."""

import ast
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from collalign.tools import SHARED

ROOT = Path(__file__).resolve().parents[1]
#: Modules of ``data_tools`` about arrays, numbers and errors, and points with normals, which know no shapes.
LEAVES = ("arrays", "checks", "errors", "local_surface", "poses", "rotations", "threads")
ALLOWED = {
    "data_tools": {"data_tools"},
    "pairwise": {"pairwise", *(f"data_tools.{leaf}" for leaf in LEAVES)},
    "collalign": {"collalign", "pairwise", "data_tools"},
}
HEAVY = {"trimesh", "cvxpy", "open3d", "matplotlib", "distributed", "clarabel", "scs", "numba"}
#: Compiled by Numba, and therefore heavy themselves.
COMPILED = {
    "pairwise.branch_and_bound.assignment",
    "pairwise.partial.screen",
}


def imported_modules(tree, *, top_level_only=False):
    """Return the dotted names that a module imports."""
    found = set()
    nodes = ast.iter_child_nodes(tree) if top_level_only else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module)
    return found


def upward_imports(package, modules):
    """Return the imports of our own packages that ``package`` must not make."""
    ours = {m for m in modules if m.split(".")[0] in ALLOWED}
    allowed = ALLOWED[package]
    return {m for m in ours if m not in allowed and not any(m.startswith(a + ".") for a in allowed if "." not in a)}


def sources():
    return [(p, f) for p in ALLOWED for f in sorted((ROOT / p).rglob("*.py"))]


@pytest.mark.parametrize(("package", "file"), sources(), ids=lambda v: getattr(v, "stem", v))
def test_imports_point_downwards(package, file):
    assert not upward_imports(package, imported_modules(ast.parse(file.read_text("utf-8"))))


@pytest.mark.parametrize(("package", "file"), sources(), ids=lambda v: getattr(v, "stem", v))
def test_heavy_libraries_are_imported_where_they_are_used(package, file):
    top = imported_modules(ast.parse(file.read_text("utf-8")), top_level_only=True)
    if ".".join(file.relative_to(ROOT).with_suffix("").parts) in COMPILED:
        top -= {"numba"} | COMPILED
    assert not {m for m in top if m.split(".")[0] in HEAVY or m in COMPILED}


def test_the_check_itself_sees_an_upward_import():
    modules = imported_modules(ast.parse("from collalign.align import align_collection\nimport numpy"))
    assert upward_imports("pairwise", modules) == {"collalign.align"}
    assert upward_imports("pairwise", {"data_tools.io.shapes"}) == {"data_tools.io.shapes"}
    assert not upward_imports("collalign", modules | {"data_tools.io.shapes", "pairwise"})


def circle(sources):
    """Return modules that import each other in a circle, by the source of each module; none where there is none.

    Imports inside functions count, since they only hide a circle; those for type checkers alone do not.
    """
    graph = {}
    for module, source in sources.items():
        tree = ast.parse(source)
        for node in ast.walk(tree):
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                node.body = [ast.Pass()]
        named = {
            f"{n.module}.{alias.name}" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for alias in n.names
        }
        graph[module] = {name for name in imported_modules(tree) | named if name in sources} - {module}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_in_a_circle():
    modules = {".".join(f.relative_to(ROOT).with_suffix("").parts): f.read_text("utf-8") for _, f in sources()}
    assert circle(modules) == []
    tied = {"a.b": "import a.c", "a.c": "def f():\n    from a import b"}
    assert set(circle(tied)) == {"a.b", "a.c"}
    assert circle(tied | {"a.c": "if TYPE_CHECKING:\n    from a import b"}) == []


#: collalign's rooms from the ground up; a room imports rooms above it in this list only, and its own modules.
ROOMS = {
    "reexported": set(),
    "version": set(),
    "wording": set(),
    "matching_input": set(),
    "engine": set(),
    "analysis": set(),
    "registration": set(),
    "options": {"engine"},
    "products": {"options"},
    "synchronization": {"products"},
    "confidence": {"products", "synchronization"},
    "nonrigid": {"confidence"},
    "landmarks": {"confidence"},
    "stages": {
        *("confidence", "engine", "matching_input", "nonrigid", "options", "products", "registration"),
        "synchronization",
    },
    "output": {"analysis", "confidence", "engine", "landmarks", "options", "products", "version", "wording"},
    "align": {"engine", "options", "output", "products", "stages"},
    "extend": {"align", "engine", "options", "output", "products"},
    "batch": {"engine", "options", "stages"},
    "console": {"engine", "output"},
    "tools": {
        *("align", "analysis", "confidence", "console", "engine", "landmarks", "matching_input", "nonrigid"),
        *("options", "output", "products", "registration", "wording"),
    },
    "cli": {
        *("align", "analysis", "batch", "console", "engine", "extend", "landmarks", "options", "output"),
        *("products", "stages", "tools", "wording"),
    },
}
#: Rooms that stand alone, with the few modules of their siblings that each may import.
ALONE = {
    "reexported": set(),
    "version": set(),
    "wording": set(),
    "matching_input": set(),
    "engine": set(),
    "analysis": set(),
    "registration": set(),
    "synchronization": {"collalign.products.pair"},
    "products": {"collalign.options"},
}
#: Modules a folder may hold, its own ``__init__`` not counted.
MOST_MODULES = 16
#: Folders of ``data_tools``, from the ground up: what lies on a surface comes after the surface.
DATA_FOLDERS = ("surface", "embedding")


def room_of(module):
    """Return the room of a module of collalign: its folder, or the module itself where it lies in none."""
    return [*module.split("."), "__init__"][1]


def tool_of(module):
    """Return the tool that a module of :mod:`collalign.tools` belongs to."""
    return [*module.split("."), ""][2]


def wrong_tools(tool, modules):
    """Return the modules of other tools that a tool must not import: all but those that several build on."""
    others = {m for m in modules if m.startswith("collalign.tools.") and tool_of(m) != tool}
    return {m for m in others if tool_of(m) not in SHARED}


def wrong_rooms(room, modules):
    """Return the modules of other rooms that a room must not import."""
    siblings = {m for m in modules if m.startswith("collalign.") and room_of(m) not in (room, "__init__")}
    wrong = {m for m in siblings if room in ROOMS and room_of(m) not in ROOMS[room]}
    return wrong | {m for m in siblings if room in ALONE and m not in ALONE[room]}


def overfull(modules):
    """Return the folders that hold too many of the modules, given as paths."""
    counts = Counter(path.rpartition("/")[0] for path in modules if not path.endswith("__init__.py"))
    return {folder: num for folder, num in counts.items() if num > MOST_MODULES}


@pytest.mark.parametrize("file", sorted((ROOT / "collalign").rglob("*.py")), ids=lambda file: file.stem)
def test_rooms_import_only_downwards(file):
    room = room_of(".".join(file.relative_to(ROOT).with_suffix("").parts))
    assert room in {*ROOMS, "__init__", "__main__"}, "a new room needs its place in the list"
    assert not wrong_rooms(room, imported_modules(ast.parse(file.read_text("utf-8"))))


@pytest.mark.parametrize("file", sorted((ROOT / "collalign" / "tools").rglob("*.py")), ids=lambda file: file.stem)
def test_tools_import_no_tool_but_the_shared_ones_and_only_commands_speak(file):
    module, imported = (
        ".".join(file.relative_to(ROOT).with_suffix("").parts),
        imported_modules(ast.parse(file.read_text("utf-8"))),
    )
    assert not wrong_tools(tool_of(module), imported)
    assert file.stem.endswith("command") or not any(m.startswith("collalign.console") for m in imported)


def test_the_check_sees_a_tool_that_imports_another():
    assert wrong_tools("match", {"collalign.tools.transfer.run", "collalign.tools.match.rigid"}) == {
        "collalign.tools.transfer.run"
    }
    assert not wrong_tools("transfer", {"collalign.tools.export.run", "collalign.output.write", "numpy"})


def test_the_check_sees_a_step_up_and_a_sibling():
    assert wrong_rooms("products", {"collalign.stages.shape_stage"}) == {"collalign.stages.shape_stage"}
    assert wrong_rooms("output", {"collalign.align"}) == {"collalign.align"}
    assert wrong_rooms("synchronization", {"collalign.products.consistent_maps"}) == {
        "collalign.products.consistent_maps"
    }
    assert not wrong_rooms("synchronization", {"collalign.products.pair", "collalign.synchronization.solve", "numpy"})
    assert not wrong_rooms("cli", {"collalign.stages.shape_stage"})


def test_the_list_of_rooms_has_no_circle():
    names = list(ROOMS)
    assert all(names.index(below) < names.index(room) for room, belows in ROOMS.items() for below in belows)


def test_no_folder_is_a_warehouse():
    paths = [str(file.relative_to(ROOT)) for _, file in sources()]
    paths += [str(file.relative_to(ROOT)) for file in (ROOT / "experiments").rglob("*.py")]
    assert not overfull(paths)
    assert overfull([f"a/b/m{i}.py" for i in range(17)] + ["a/b/__init__.py"]) == {"a/b": 17}
    assert not overfull([f"a/b/m{i}.py" for i in range(16)] + ["a/b/__init__.py"])


#: Stems that every tool may have.
TOOL_STEMS = ("run", "files", "command", "result")


def repeated_stems(paths):
    """Return the stems of modules that a package has more than once, those that tools share set aside."""
    own = [p for p in paths if not p.endswith("__init__.py") and not ("/tools/" in p and Path(p).stem in TOOL_STEMS)]
    return sorted(stem for stem, count in Counter(Path(p).stem for p in own).items() if count > 1)


@pytest.mark.parametrize("package", ALLOWED)
def test_a_file_name_says_where_it_is(package):
    assert repeated_stems([f.relative_to(ROOT).as_posix() for p, f in sources() if p == package]) == []
    assert repeated_stems(["a/poses.py", "a/b/poses.py", "a/tools/x/run.py", "a/tools/y/run.py"]) == ["poses"]


def test_surfaces_know_nothing_of_embeddings():
    below, above = DATA_FOLDERS
    imported = [imported_modules(ast.parse(f.read_text("utf-8"))) for f in (ROOT / "data_tools" / below).glob("*.py")]
    assert not any(module.startswith(f"data_tools.{above}") for modules in imported for module in modules)


#: Says the unit, not a choice.
HALF_TURN_DEG = 180.0
#: Holds a published hash, number by number.
PUBLISHED = ROOT / "collalign" / "stages" / "pairs" / "sparse_pairs.py"


def unnamed_numbers(source):
    """Numbers inside functions that are neither small integers, nor halves of them, nor guards against rounding."""
    functions = [n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef)]
    numbers = {n for f in functions for n in ast.walk(f) if isinstance(n, ast.Constant)}
    values = [n.value for n in numbers if isinstance(n.value, int | float) and not isinstance(n.value, bool)]
    return [v for v in values if 1e-6 < v < 1e12 and (v > 9 or 2 * v != int(2 * v)) and v != HALF_TURN_DEG]


@pytest.mark.parametrize("room", ["synchronization", "stages", "registration", "landmarks"])
def test_the_numbers_of_estimators_have_names(room):
    for path in {*(ROOT / "collalign" / room).rglob("*.py")} - {PUBLISHED}:
        assert unnamed_numbers(path.read_text("utf-8")) == [], path
    assert unnamed_numbers("LIMIT = 60\ndef f(x, tol=0.3):\n    return 1.5 * x + 1e-12 if x < 12 else 2") in (
        [0.3, 12],
        [12, 0.3],
    )
