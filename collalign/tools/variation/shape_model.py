"""What shape is tested against: columns of labels as groups or numbers, and models of several of them."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from collalign.analysis.shape_tests import NUM_PERMUTATIONS, SEED, SEQUENTIAL, SUMS_OF_SQUARES
from data_tools.arrays import BoolArray, FloatArray
from data_tools.checks import check_choice, check_count, check_known
from data_tools.errors import InputError
from data_tools.notes import Note

#: What a model calls the logarithm of centroid size, and tables.
SIZE_TERM, SIZE = "size", "log(centroid size)"


@dataclass(frozen=True, kw_only=True)
class ShapeTestOptions:
    """What shape is tested against, and how.

    Parameters
    ----------
    factors : tuple of str
        Columns of numbers that are names of groups (1 = female). Any other column of numbers is a covariate.
    model : str
        A model of your own, such as "size + sex + age" or "size * sex": columns of the labels, and size, the
        logarithm of centroid size.
    sums_of_squares : str
        I: each term beyond those before it. II: each term beyond all others that do not contain it.
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
    model: str = ""
    sums_of_squares: str = SEQUENTIAL
    permutations: int = NUM_PERMUTATIONS
    seed: int = SEED

    def __post_init__(self) -> None:
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


def read_column(
    name: str, values: Sequence[str], shapes: Sequence[str], *, as_factor: bool = False
) -> Column:
    """Return a column of labels as covariate, where all its values are numbers, or as factor.

    Parameters
    ----------
    name : str
    values : sequence of str, length N
    shapes : sequence of str, length N
        Names, for notes.
    as_factor : bool
        Numbers are names of groups.
    """
    known = np.array([value != "" for value in values], dtype=bool)
    numbers = [_number(value) for value in values]
    if (
        not as_factor
        and known.any()
        and all(math.isfinite(numbers[at]) for at in np.flatnonzero(known))
    ):
        return Column(
            name=name, values=tuple(values), numbers=np.array(numbers), tested=known, notes=()
        )
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
        check_known("model", {*names}, [SIZE_TERM, *columns])
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


def _number(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        return math.nan
