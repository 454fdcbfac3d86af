"""A fault in a module: the text with it, and in which function and lines it is."""

import ast
from dataclasses import dataclass

#: Stands for the body of a module outside of all functions: its constants.
MODULE = "<module>"


@dataclass(frozen=True)
class Mutant:
    """One fault.

    Attributes
    ----------
    file : str
        Path of the module.
    function : str
        Name of the function or method, with its class, or ``MODULE`` for all that stands outside of functions.
    line : int
        First line of the fault, from 0.
    old, new : str
        The lines that change, and what replaces them.
    changed : str
        Text of the module with the fault.
    tests : tuple of str
        Tests that should notice; none of them needs data.
    """

    file: str
    function: str
    line: int
    old: str
    new: str
    changed: str
    tests: tuple[str, ...] = ()

    def __str__(self):
        return f"{self.file} {self.function}: {self.old!r} -> {self.new!r}"


def function_spans(tree):
    """Return first and last line (exclusive, from 0) of every function by its name, methods with their class."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = (node.lineno - 1, int(node.end_lineno or 0))
        elif isinstance(node, ast.ClassDef):
            for child in node.body:
                if isinstance(child, ast.FunctionDef):
                    found[f"{node.name}.{child.name}"] = (
                        child.lineno - 1,
                        int(child.end_lineno or 0),
                    )
    return found
