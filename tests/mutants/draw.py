"""Faults at places drawn at random over the three packages, for the tests of the modules and their users."""

import ast
import random
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.mutants.place import MODULE, Mutant, function_spans

PACKAGES = ("collalign", "data_tools", "pairwise")

_COMPARISONS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.In: "not in", ast.NotIn: "in", ast.Is: "is not", ast.IsNot: "is",
}  # fmt: skip
_OPERATIONS = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "/", ast.Mod: "*", ast.Pow: "*",
    ast.BitAnd: "|", ast.BitOr: "&",
}  # fmt: skip
_NAMES = {
    "min": "max", "max": "min", "any": "all", "all": "any", "argmin": "argmax", "argmax": "argmin",
    "minimum": "maximum", "maximum": "minimum", "floor": "ceil", "ceil": "floor", "sum": "max", "mean": "sum",
}  # fmt: skip


@dataclass(frozen=True)
class Change:
    """Characters ``start`` to ``end`` of a module's text, and what replaces them."""

    start: int
    end: int
    new: str


class _Offsets:
    """Where nodes begin and end in a text, in characters."""

    def __init__(self, source):
        self._source = source
        self._lines = source.splitlines(keepends=True)
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))

    def start(self, node):
        return self._at(node.lineno, node.col_offset)

    def end(self, node):
        return self._at(node.end_lineno, node.end_col_offset)

    def between(self, left, right, operator):
        """Replace the operator between two operands, and no parenthesis or line break around it."""
        start, end = self.end(left), self.start(right)
        text = self._source[start:end]
        inner = text.strip("() \n\t")
        at = start + text.index(inner)
        return Change(at, at + len(inner), operator)

    def _at(self, line, column):
        """Columns of the syntax tree are bytes."""
        return self._starts[line - 1] + len(self._lines[line - 1].encode()[:column].decode())


def draw(root, num, seed):
    """Return so many different faults, every place of the packages equally likely.

    Parameters
    ----------
    root : Path
        The project.
    num, seed : int
    """
    files = [path for package in PACKAGES for path in sorted((root / package).rglob("*.py"))]
    places = [(path, change) for path in files for change in changes(path.read_text("utf-8"))]
    chosen = random.Random(seed).sample(places, min(num, len(places)))
    imports = Imports(root)
    named = [
        (str(path.relative_to(root)), path.read_text("utf-8"), change) for path, change in chosen
    ]
    return [as_mutant(name, text, change, imports.tests_of(name)) for name, text, change in named]


@cache
def changes(source):
    """Return the faults that may be put into a module, one per place: operators, numbers, conditions, calls."""
    at = _Offsets(source)
    return [change for node in _code(ast.parse(source)) for change in _changes_of(node, source, at)]


def _code(node):
    """Return all nodes but annotations, imports, decorators and texts."""
    yield node
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(
                child, (ast.Import, ast.ImportFrom, ast.JoinedStr)
            ):
                yield from _code(child)


def _changes_of(node, source, at):
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=[right]):
            yield at.between(left, right, _COMPARISONS[type(operator)])
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATIONS:
            if not _is_type_or_text(left) and not _is_type_or_text(right):
                yield at.between(left, right, _OPERATIONS[type(operator)])
        case ast.BoolOp(op=operator, values=[left, right]):
            yield at.between(left, right, "or" if isinstance(operator, ast.And) else "and")
        case ast.UnaryOp(op=ast.Not() | ast.USub() as operator):
            length = len("not") if isinstance(operator, ast.Not) else len("-")
            yield Change(at.start(node), at.start(node) + length, "")
        case ast.Constant(value=bool() as value):
            yield Change(at.start(node), at.end(node), str(not value))
        case ast.Constant(value=int() | float() as number):
            yield Change(
                at.start(node),
                at.end(node),
                repr(number + 1 if isinstance(number, int) else 2 * number or 1.0),
            )
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in _NAMES:
            end = at.end(node.func)
            yield Change(end - len(name), end, _NAMES[name])
        case ast.If(test=test):
            yield Change(
                at.start(test), at.end(test), f"not ({source[at.start(test) : at.end(test)]})"
            )
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Continue() | ast.Break():
            yield Change(at.start(node), at.end(node), "pass")


def _is_type_or_text(node):
    """Whether an operator there joins types or texts."""
    if isinstance(node, ast.Constant):
        return node.value is None or isinstance(node.value, str)
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Name) and node.id[0].isupper() and not node.id.isupper()
    )


def as_mutant(file, source, change, tests=()):
    """Return the fault that a change is in the text of a module."""
    changed = source[: change.start] + change.new + source[change.end :]
    first = source.count("\n", 0, change.start)
    old, new = source.split("\n")[first:], changed.split("\n")[first:]
    num = source.count("\n", change.start, change.end) + 1
    spans = function_spans(ast.parse(source)).items()
    function = next((name for name, (begin, end) in spans if begin <= first < end), MODULE)
    lines = "\n".join(old[:num]), "\n".join(new[: num + len(new) - len(old)])
    return Mutant(file, function, first, *lines, changed, tests)


class Imports:
    """Which test files see a module: by importing it, or modules that import it."""

    def __init__(self, root):
        self._of = {
            str(path.relative_to(root)): _imported(path.read_text("utf-8"))
            for folder in (*PACKAGES, "tests")
            for path in sorted((root / folder).rglob("*.py"))
        }

    def tests_of(self, file):
        """Return the module's tests, then those of its users; where nobody imports it, those of the folder."""
        folder = str(Path(file).parent)
        return self._seeing(file) or self._seeing(
            *(other for other in self._of if str(Path(other).parent) == folder)
        )

    def _seeing(self, *files):
        level, seen, tests = set(files), set(files), []
        for depth in range(len(self._of)):
            users = [
                other for other in self._of if any(_module(one) in self._of[other] for one in level)
            ]
            tests += [
                user for user in users if Path(user).name.startswith("test_") and user not in tests
            ]
            level = {user for user in users if not user.startswith("tests/")} - seen
            seen |= level
            if not level or (tests and depth > 0):
                break
        return tuple(tests)


def _module(file):
    return file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


@cache
def _imported(source):
    """Return the modules that a text imports, and those of which it imports names, by their dotted names."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def by_package(endings):
    """Return killed ones and all with a verdict, of each package."""
    counts = dict.fromkeys(PACKAGES, (0, 0))
    for mutant, ending in endings:
        package = mutant.file.split("/")[0]
        killed, tried = counts[package]
        if ending in ("killed", "survived"):
            counts[package] = killed + (ending == "killed"), tried + 1
    return counts
