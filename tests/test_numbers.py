"""Numbers with names of their own stay few: what follows is computed, what was tuned together lies in a table."""

import ast
from pathlib import Path

import pytest

from tests.test_layers import sources

#: Named numbers of all packages, at most, and those of them that share a line with others, as ``A, B = 1, 2``.
MOST_ALONE, MOST_TOGETHER = 333, 236


def is_number(value):
    """Whether an expression is a number as it is written: a literal, arithmetic on such, or several of them."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return is_number(value.left) and is_number(value.right)
    return isinstance(value, ast.Tuple | ast.List) and bool(value.elts) and all(map(is_number, value.elts))


def named_numbers(text):
    """Return the upper-case names of a module that are numbers: those alone on a line, and those that share one."""
    alone, together = [], []
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None else ():
            if isinstance(target, ast.Name) and target.id.lstrip("_").isupper() and is_number(node.value):
                alone.append(target.id)
            elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                together += [
                    name.id for name, value in zip(target.elts, node.value.elts, strict=True) if is_number(value)
                ]
    return alone, together


def test_named_numbers_are_few():
    found = [named_numbers(file.read_text("utf-8")) for _, file in sources()]
    assert sum(len(alone) for alone, _ in found) <= MOST_ALONE
    assert sum(len(together) for _, together in found) <= MOST_TOGETHER


@pytest.mark.parametrize("line", ["A = 1", "_B: float = -2.5e-3", "C = 3 * 2**20", "D = (0.6, 0.3)", "E = [1]"])
def test_the_count_sees_numbers(line):
    assert named_numbers(f"import os\n{line}\n") == ([line.split()[0].rstrip(":")], [])


@pytest.mark.parametrize(
    "line", ["A = True", "a = 1", "A = 2 * B", "A = len(b)", "A = ()", "def f():\n    A = 1", 'A = "b"', "A: int"]
)
def test_the_count_leaves_what_is_computed_or_local(line):
    assert named_numbers(line) == ([], [])


def test_numbers_that_share_a_line_count_one_by_one():
    assert named_numbers('A, B, C = 1, "b", (2, 3)') == ([], ["A", "C"])
    assert named_numbers(Path(__file__).read_text("utf-8")) == ([], ["MOST_ALONE", "MOST_TOGETHER"])
