"""How much the results move when a tuned number is halved and doubled: ``python -m experiments sensitivity``.

A tuned number is a literal in a constant of a module (a name in capitals) or in a default of a ``NamedTuple``, as the
value itself, or inside of tuples, lists, dictionaries, arithmetic and :data:`CALLS`. Zeros, indices, text and the
arguments of other calls are none. Each literal is one number: ``module.NAME`` where the constant holds one, else
``module.NAME[2]``, counted from 0.

Every number is changed in the source of a copy of the product, and the copy is run in a process of its own: so
whatever is computed of the number changes with it, in workers too.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from collalign.engine.records import Record, decode, encode
from data_tools.arrays import FloatArray
from data_tools.errors import CollectionError, OptionsError
from experiments.collections.posed import GROSS_DEG
from experiments.collections.scoreboard import measure_set
from experiments.confidence.reliability import SURE, USABLE
from experiments.experiment import Bench, Cell
from experiments.provenance import PRODUCT, ROOT, code_digest
from experiments.tables import Column, Row, Table, Value

#: Rooms whose numbers decide poses and confidences.
ROOMS = ("collalign.confidence", "collalign.stages", "collalign.synchronization")
#: Functions in whose arguments numbers count.
CALLS = ("array", "deg2rad", "cos", "sin", "log", "sqrt")
#: The scoreboard in small: sets and their members that take some seconds each, one draw of each.
SMALL = (
    ("generated families", "crowns, mirrored"),
    ("generated families", "chairs"),
    ("generated families", "bent figures"),
    ("generated families", "chairs, cut"),
    ("SHREC07", "ant"),
    ("SHREC07", "chair"),
    ("teeth", "teeth"),
)
FACTORS = {"halved": 0.5, "doubled": 2.0}


@dataclass(frozen=True, kw_only=True)
class Number:
    """One tuned number.

    Attributes
    ----------
    name : str
        Dotted, see the module.
    file : str
        Below the folder of the packages.
    start, end : int
        Where the literal stands in the bytes of the file.
    value : int or float
    """

    name: str
    file: str
    start: int
    end: int
    value: float

    def changed(self, factor: float) -> float:
        """Return the number times a factor; counts stay whole, and at least one."""
        return (
            max(1, round(factor * self.value))
            if isinstance(self.value, int)
            else factor * self.value
        )


def tuned_numbers(places: Sequence[str] = ROOMS, *, root: Path = ROOT) -> tuple[Number, ...]:
    """Return the tuned numbers of rooms, modules, or constants, in the order of the source.

    Parameters
    ----------
    places : sequence of str
        Dotted names of what is wanted.
    root : Path
        Folder of the packages.

    Raises
    ------
    OptionsError
        If a place holds none.
    """
    every = [
        number
        for package in PRODUCT
        for file in sorted((root / package).rglob("*.py"))
        for number in _numbers_of(file, root)
    ]
    found = dict[Number, None]()
    for place in places:
        own = [
            one
            for one in every
            if one.name == place or one.name.startswith((f"{place}.", f"{place}["))
        ]
        if not own:
            raise OptionsError(
                f"{place}: holds no tuned number; name a room, a module or a constant with its module"
            )
        found |= dict.fromkeys(own)
    return tuple(found)


def _numbers_of(file: Path, root: Path) -> Iterator[Number]:
    content = file.read_bytes()
    starts = np.cumsum([0, *map(len, content.splitlines(keepends=True))])
    relative = file.relative_to(root)
    module = ".".join(relative.with_suffix("").parts).removesuffix(".__init__")
    for name, value in _constants(ast.parse(content)):
        literals = [(one, number) for one, number in _literals(value) if number]
        for at, (one, number) in enumerate(literals):
            yield Number(
                name=f"{module}.{name}" + (f"[{at}]" if len(literals) > 1 else ""),
                file=relative.as_posix(),
                start=int(starts[one.lineno - 1]) + one.col_offset,
                end=int(starts[(one.end_lineno or 0) - 1]) + (one.end_col_offset or 0),
                value=number,
            )


def _constants(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield the names and values of constants of a module, and of the defaults of its named tuples."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases):
            for one in node.body:
                if isinstance(one, ast.AnnAssign) and one.value is not None:
                    yield f"{node.name}.{ast.unparse(one.target)}", one.value
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            for name, value in ((ast.unparse(one), own) for one, own in pairs):
                if name.isupper() and "VERSION" not in name:
                    yield name, value


def _literals(value: ast.expr) -> Iterator[tuple[ast.Constant, float]]:
    """Yield the numbers of an expression that count, each with its place."""
    if isinstance(value, ast.Constant):
        number = value.value
        if isinstance(number, int | float) and not isinstance(number, bool):
            yield value, number
    elif isinstance(value, ast.Call):
        if ast.unparse(value.func).rpartition(".")[2] in CALLS:
            for one in value.args:
                yield from _literals(one)
    elif isinstance(value, ast.Dict):
        for one in value.values:
            yield from _literals(one)
    elif isinstance(value, ast.Tuple | ast.List | ast.UnaryOp | ast.BinOp):
        for child in ast.iter_child_nodes(value):
            if isinstance(child, ast.expr):
                yield from _literals(child)


#: Measures a set with the product of the working folder, from the file ``settings`` to the file ``record``.
_MEASURE = """
import sys
from pathlib import Path
from collalign.engine.records import decode, encode
from experiments.collections.scoreboard import measure_set
from experiments.experiment import Cell
settings = decode(Path("settings").read_bytes(), "settings")
Path("record").write_bytes(encode(measure_set(Cell(data=Path(sys.argv[1]), settings=settings))))
"""


def measure_changed(cell: Cell) -> Record:
    """Measure a set of the scoreboard with one number changed.

    Settings: those of :func:`experiments.collections.scoreboard.measure_set`, ``file``, ``start``, ``end`` and
    ``text``, which takes the place of the literal.
    """
    change = {name: cell.settings[name] for name in ("file", "start", "end", "text")}
    settings = {name: value for name, value in cell.settings.items() if name not in change}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Compiled kernels come along: the changed file's are made anew, and none takes numbers of another module.
        for package in (*PRODUCT, "experiments"):
            shutil.copytree(ROOT / package, folder / package)
        file = folder / change["file"]
        content = file.read_bytes()
        file.write_bytes(
            content[: change["start"]] + change["text"].encode() + content[change["end"] :]
        )
        (folder / "settings").write_bytes(encode(settings))
        done = subprocess.run(
            [sys.executable, "-c", _MEASURE, str(cell.data.resolve())],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": name},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise CollectionError(
                f"with {change['text']} in {change['file']}: {done.stderr.strip()[-500:]}"
            )
        return decode((folder / "record").read_bytes(), "record")


def sensitivity(bench: Bench, places: Sequence[str] = ROOMS) -> Table:
    """Return by how much the small scoreboard moves when each number is halved and doubled, what moves most first.

    Finished measurements are kept in the bench's store, by the product's code: an interrupted run goes on.

    Parameters
    ----------
    bench : Bench
        With ``quick`` one generated family alone.
    places : sequence of str
        Rooms, modules or constants.
    """
    numbers, code = tuned_numbers(places), code_digest(ROOT)
    sets = {
        f"{of}: {name}": {"set": of, "name": name, "draw": 0, "code": code}
        for of, name in SMALL[: 1 if bench.quick else None]
    }
    changes = {
        (number.name, how): {
            "file": number.file,
            "start": number.start,
            "end": number.end,
            "text": repr(number.changed(factor)),
        }
        for number in numbers
        for how, factor in FACTORS.items()
        if number.changed(factor) != number.value
    }
    plain = bench.measure(measure_set, sets)
    cells = {
        f"{name} {how}, {label}": settings | change
        for (name, how), change in changes.items()
        for label, settings in sets.items()
    }
    found = bench.measure(measure_changed, cells)
    before, rows = _joined(plain.values()), list[tuple[float, Row]]()
    for number in numbers:
        row: dict[str, Value] = {"number": number.name, "value": f"{number.value:.6g}"}
        most = 0.0
        for how in FACTORS:
            if (number.name, how) in changes:
                after = _joined(found[f"{number.name} {how}, {label}"] for label in sets)
                moved = moves(before, after)
                row |= {f"{how} {key}": value for key, value in moved.items()}
                most = max(most, *map(abs, moved.values()))
        rows.append((most, {**row, "moves": most}))
    of_factors = (
        Column(key=f"{how} {key}", title=f"{how}: {title}", format="+.1f")
        for how in FACTORS
        for key, title in FIGURES.items()
    )
    return Table(
        caption=f"{len(numbers)} numbers on {', '.join(sets)}; differences in per cent of pairs or shapes.",
        columns=(
            Column(key="number", title="number"),
            Column(key="value", title="value"),
            *of_factors,
            Column(key="moves", title="largest", format=".1f"),
        ),
        rows=tuple(row for _, row in sorted(rows, key=lambda one: -one[0])),
    )


#: What is compared.
FIGURES = {
    "gross": "gross pairs",
    "wrong": f"wrong at {SURE}",
    "usable": f"right at {USABLE}",
    "stated": "mean change of what is stated",
}


def _joined(records: Iterable[Record]) -> dict[str, FloatArray]:
    every = list(records)
    keys = ("pair_deg", "shape_deg", "stated")
    return {key: np.concatenate([one[key] for one in every]) for key in keys}


def moves(before: Mapping[str, FloatArray], after: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return the differences of :data:`FIGURES` between two measurements of the same draws, in per cent."""

    def shares(one: Mapping[str, FloatArray]) -> FloatArray:
        wrong, right = one["shape_deg"] > GROSS_DEG, one["shape_deg"] <= GROSS_DEG
        of_all = (
            one["pair_deg"] > GROSS_DEG,
            wrong & (one["stated"] >= SURE),
            right & (one["stated"] >= USABLE),
        )
        return 100.0 * np.array([own.mean() for own in of_all])

    apart = 100.0 * float(np.nanmean(np.abs(after["stated"] - before["stated"])))
    differences = [*(shares(after) - shares(before)).tolist(), apart]
    return dict(zip(FIGURES, differences, strict=True))
