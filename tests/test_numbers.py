"""Numbers with names of their own stay few: what follows is computed, what was tuned together lies in a table."""

import ast

import pytest

from tests.test_layers import sources

#: Named numbers of all packages, at most, and those of them that share a line with others, as ``A, B = 1, 2``.
MOST_ALONE, MOST_TOGETHER = 333, 225
#: What numbers are written of: literals, arithmetic on such, and several of them.
WRITTEN = (
    ast.Constant,
    ast.UnaryOp,
    ast.BinOp,
    ast.Tuple,
    ast.List,
    ast.operator,
    ast.unaryop,
    ast.expr_context,
)


def is_number(value):
    """Whether an expression is a number as it is written, or several of them."""
    nodes = [*ast.walk(value)]
    values = [type(node.value) for node in nodes if isinstance(node, ast.Constant)]
    return (
        bool(values)
        and {*values} <= {int, float}
        and all(isinstance(node, WRITTEN) for node in nodes)
    )


def named_numbers(text):
    """Return the upper-case names of a module that are numbers: those alone on a line, and those that share one."""
    alone, together = [], []
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in (
            targets
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
            else ()
        ):
            if (
                isinstance(target, ast.Name)
                and target.id.lstrip("_").isupper()
                and is_number(node.value)
            ):
                alone.append(target.id)
            elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(target.elts, node.value.elts, strict=True)
                together += [name.id for name, value in pairs if is_number(value)]
    return alone, together


def test_named_numbers_are_few():
    found = [named_numbers(file.read_text("utf-8")) for _, file in sources()]
    assert sum(len(alone) for alone, _ in found) <= MOST_ALONE
    assert sum(len(together) for _, together in found) <= MOST_TOGETHER


@pytest.mark.parametrize(
    "line", ["A = 1", "_B: float = -2.5e-3", "C = 3 * 2**20", "D = (0.6, 0.3)", "E = [1]"]
)
def test_the_count_sees_numbers(line):
    assert named_numbers(f"import os\n{line}\n") == ([line.split()[0].rstrip(":")], [])


def test_the_count_leaves_what_is_computed_or_local_and_splits_lines():
    others = (
        "A = True",
        "a = 1",
        "A = 2 * B",
        "A = len(b)",
        "A = ()",
        "def f():\n    A = 1",
        'A = "b"',
        "A: int",
    )
    assert {line: named_numbers(line) for line in others} == dict.fromkeys(others, ([], []))
    assert named_numbers('A, B, C = 1, "b", (2, 3)') == ([], ["A", "C"])
