"""What shape is tested against: columns of labels as groups or numbers, and models of several of them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from collalign.analysis.label_checks import as_numbers, wrong_cells
from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED, SEQUENTIAL, SUMS_OF_SQUARES
from data_tools.arrays import BoolArray, FloatArray
from data_tools.checks import check_choice, check_count
from data_tools.errors import InputError, OptionsError
from data_tools.names import known_names
from data_tools.notes import Note, listed

#: What a model calls the logarithm of centroid size, and tables.
SIZE_TERM, SIZE = "size", "log(centroid size)"


@dataclass(frozen=True, kw_only=True)
class ShapeTestOptions:
    """What shape is tested against, and how.

    Parameters
    ----------
    factors : tuple of str
        Columns that are names of groups, though they may be numbers (1 = female).
    numbers : tuple of str
        Columns that are numbers. Of the other columns, those are whose cells are numbers, all but a few, which are
        refused.
    model : str
        A model of your own, such as "size + sex + age" or "size * sex": columns of the labels, and size, the
        logarithm of centroid size.
    sums_of_squares : str
        I: each term beyond those before it. II: each term beyond all others that do not contain it.
    blocks : tuple of str
        Blocks of landmarks that are tested for integration, such as "face=LM1..LM8" or "base=LM9,LM11": names, and
        ranges in the order of the landmarks.
    permutations : int
        Random permutations of every test; many journals ask for 9999.
    seed : int
        Of the permutations.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    factors: tuple[str, ...] = ()
    numbers: tuple[str, ...] = ()
    model: str = ""
    sums_of_squares: str = SEQUENTIAL
    blocks: tuple[str, ...] = ()
    permutations: int = NUM_PERMUTATIONS
    seed: int = SEED

    def __post_init__(self) -> None:
        if both := {*self.factors} & {*self.numbers}:
            raise OptionsError(f"factors, numbers: {min(both)!r} cannot be both")
        check_choice("sums_of_squares", self.sums_of_squares, SUMS_OF_SQUARES)
        check_count("permutations", self.permutations, lower=99)
        check_count("seed", self.seed, lower=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """A column of labels as tests take it.

    Attributes
    ----------
    name : str
    values : tuple of str
        ``""`` where unknown.
    numbers : ndarray, shape (N,), or None
        Of a covariate, NaN where unknown; None for a factor.
    tested : ndarray of bool, shape (N,)
        Which shapes count: those with a value, and not alone in their group.
    notes : tuple of Note
        Who does not, and why.
    """

    name: str
    values: tuple[str, ...]
    numbers: FloatArray | None
    tested: BoolArray
    notes: tuple[Note, ...]

    @property
    def groups(self) -> list[str]:
        """The groups that are tested, in alphabetical order."""
        return sorted(
            {
                value
                for value, counts in zip(self.values, self.tested.tolist(), strict=True)
                if counts
            }
        )

    def design(self, chosen: BoolArray) -> FloatArray:
        """Return the columns of the design (n, q) for the chosen ones of all shapes (N,)."""
        if self.numbers is not None:
            return self.numbers[chosen, None]
        values = np.array(self.values, dtype=str)[chosen]
        return (values[:, None] == np.unique(values)).astype(np.float64)

    def alone(self, chosen: BoolArray) -> BoolArray:
        """Return which of some shapes are alone in their group among these, shape (N,); none of a covariate."""
        values = np.array(self.values, dtype=str)
        kinds, counts = np.unique(values[chosen], return_counts=True)
        return chosen & np.isin(values, kinds[counts == 1]) & (self.numbers is None)


def settled_columns(
    options: ShapeTestOptions, columns: Mapping[str, Sequence[str]], shapes: Sequence[str]
) -> ShapeTestOptions:
    """Return options that say of every column of labels whether it is a factor or numbers.

    Parameters
    ----------
    options : ShapeTestOptions
        What is declared; names of columns that nearly agree are corrected.
    columns : mapping of str to sequence of str, length N
        ``""`` where unknown.
    shapes : sequence of str, length N
        Names, for messages.

    Raises
    ------
    InputError
        If there is no column of a name; if few cells of a column, or any of one that is declared to be numbers, are
        no numbers. They are named.
    """
    factors, numbers = (
        {*known_names(argument, asked, columns, kind="column").values()}
        for argument, asked in (("factors", options.factors), ("numbers", options.numbers))
    )
    for column, values in columns.items():
        wrong = wrong_cells(values, shapes, declared=column in numbers)
        if column in factors or wrong is None:
            factors.add(column)
            continue
        if wrong:
            right = sum(map(bool, values)) - len(wrong)
            cells = listed([f"{shape} has {cell!r}, not a number" for shape, cell in wrong.items()])
            advice = (
                ""
                if column in numbers
                else f", or use --factors {shlex.quote(column)} if it names groups"
            )
            raise InputError(
                f"{column}: {cells}. {right} other cells are numbers. Correct the table, leaving "
                f"empty what is unknown{advice}"
            )
        numbers.add(column)
    in_order = [
        tuple(column for column in columns if column in kind) for kind in (factors, numbers)
    ]
    return replace(options, factors=in_order[0], numbers=in_order[1])


def read_column(
    name: str, values: Sequence[str], shapes: Sequence[str], *, as_factor: bool
) -> Column:
    """Return a column of labels as covariate or as factor.

    Parameters
    ----------
    name : str
    values : sequence of str, length N
    shapes : sequence of str, length N
        Names, for notes.
    as_factor : bool
        Values are names of groups, else numbers.
    """
    known = np.array([value != "" for value in values], dtype=bool)
    if not as_factor:
        numbers = as_numbers(values)
        return Column(name=name, values=tuple(values), numbers=numbers, tested=known, notes=())
    kinds, counts = np.unique(np.array(values, dtype=str), return_counts=True)
    single = {*kinds[counts == 1].tolist()} - {""}
    alone = {shape: value for shape, value in zip(shapes, values, strict=True) if value in single}
    note = Note("groups-of-one", tuple(alone), {"column": name, "groups": tuple(alone.values())})
    tested = known & ~np.isin(values, [*single])
    return Column(
        name=name, values=tuple(values), numbers=None, tested=tested, notes=(note,) if alone else ()
    )


def parse_model(model: str, columns: Collection[str]) -> tuple[tuple[str, ...], ...]:
    """Return the terms of a model, each the names that it multiplies, in order.

    ``shape ~ size * sex`` is ``size``, ``sex``, ``size:sex``.

    Raises
    ------
    InputError
        If a name is none of the columns, or the model cannot be read.
    """
    terms: dict[tuple[str, ...], None] = {}
    for part in re.sub(r"^\s*\w*\s*~", "", model).split("+"):
        factors = [[name.strip() for name in product.split(":")] for product in part.split("*")]
        names = [name for product in factors for name in product]
        if not all(names):
            raise InputError(
                f"model: {model!r} cannot be read; write it as in 'size + sex + age' or 'size * sex'"
            )
        called = known_names("model", names, [SIZE_TERM, *columns], kind="column")
        factors = [[called[name] for name in product] for product in factors]
        names = [called[name] for name in names]
        if len(factors) > 2:
            raise InputError(
                f"model: {part.strip()!r} multiplies more than two terms; write 'a:b:c' for each of them"
            )
        terms |= dict.fromkeys(map(tuple, factors))
        if len(factors) > 1:
            terms[tuple(names)] = None
    return tuple(terms)


def model_terms(
    terms: Sequence[tuple[str, ...]], columns: Mapping[str, Column], sizes: FloatArray
) -> tuple[dict[str, FloatArray], BoolArray]:
    """Return the design of each term, and the shapes (N,) that have a value in all columns and share their groups.

    Parameters
    ----------
    terms : sequence of tuple of str
        As :func:`parse_model` returns them.
    columns : mapping of str to Column
    sizes : ndarray, shape (N,)
        Logarithms of centroid sizes.
    """
    used = {name for term in terms for name in term} - {SIZE_TERM}
    in_model = [columns[name] for name in sorted(used)]
    none = np.zeros(len(sizes), dtype=bool)
    chosen = np.all([~none, *(column.tested for column in in_model)], axis=0)
    while (alone := np.any([none, *(column.alone(chosen) for column in in_model)], axis=0)).any():
        chosen = chosen & ~alone
    parts = {name: columns[name].design(chosen) for name in used} | {SIZE_TERM: sizes[chosen, None]}
    designs = {}
    for term in terms:
        product = np.ones((int(chosen.sum()), 1))
        for name in term:
            product = (product[:, :, None] * parts[name][:, None, :]).reshape(len(product), -1)
        designs[":".join(SIZE if name == SIZE_TERM else name for name in term)] = product
    return designs, chosen


def missing_notes(model: str, names: Sequence[str], chosen: BoolArray) -> tuple[Note, ...]:
    """Return the note on the shapes that a model leaves out, of which ``chosen`` (N,) has the others."""
    absent = tuple(name for name, counts in zip(names, chosen.tolist(), strict=True) if not counts)
    return (Note("model-leaves-out", absent, {"model": model}),) if absent else ()
