"""A place of the code and a fault to put there, named by function and text so that it survives moves of lines."""

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
    old, new : str
        Text that occurs exactly once in that function, and what replaces it.
    tests : tuple of str
        Tests that should notice; none of them needs data.
    """

    file: str
    function: str
    old: str
    new: str
    tests: tuple[str, ...]

    def __str__(self):
        return f"{self.file} {self.function}: {self.old!r} -> {self.new!r}"


def mutated(source, mutant):
    """Return a module's text with the fault in it.

    Raises
    ------
    ValueError
        If there is no such function, its text does not hold ``old`` exactly once, or the result is no Python.
    """
    lines = source.splitlines(keepends=True)
    spans = function_spans(ast.parse(source))
    if mutant.function == MODULE:
        inside = set(range(len(lines)))
        inside -= {i for name, (first, last) in spans.items() for i in range(first, last)}
    elif mutant.function in spans:
        inside = set(range(*spans[mutant.function]))
    else:
        raise ValueError(f"{mutant}: there is no such function")
    text = "".join(line if i in inside else "\0" * (len(line) - 1) + "\n" for i, line in enumerate(lines))
    if text.count(mutant.old) != 1:
        raise ValueError(f"{mutant}: occurs {text.count(mutant.old)} times, expected once")
    at = text.index(mutant.old)
    changed = source[:at] + mutant.new + source[at + len(mutant.old) :]
    ast.parse(changed)
    if ast.dump(ast.parse(changed)) == ast.dump(ast.parse(source)):
        raise ValueError(f"{mutant}: changes nothing")
    return changed


def applied(mutant, root):
    """Return the text of the mutant's module under ``root`` with the fault in it; raises as :func:`mutated`."""
    path = root / mutant.file
    if not path.is_file():
        raise ValueError(f"{mutant}: there is no such module")
    return mutated(path.read_text("utf-8"), mutant)


def function_spans(tree):
    """Return first and last line (exclusive, from 0) of every function by its name, methods with their class."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = (node.lineno - 1, int(node.end_lineno or 0))
        elif isinstance(node, ast.ClassDef):
            for child in node.body:
                if isinstance(child, ast.FunctionDef):
                    found[f"{node.name}.{child.name}"] = (child.lineno - 1, int(child.end_lineno or 0))
    return found
