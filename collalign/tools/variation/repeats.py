"""Several shapes of one individual: left and right compared, and the error of measurement, as tables and in words."""

from __future__ import annotations

from collections.abc import Sequence

from collalign.analysis.measurement_error import (
    MeasurementError,
    check_repeats,
    measurement_error,
)
from collalign.analysis.paired_sides import (
    INDIVIDUAL,
    INTERACTION,
    SIDE,
    PairedSides,
    paired_sides,
    with_both_sides,
)
from collalign.tools.variation.shape_statistics import Rows, symmetry_rows
from data_tools.arrays import FloatArray
from data_tools.errors import InputError
from data_tools.notes import Note, Value


def check_individuals(
    individuals: Sequence[str] | None,
    sides: Sequence[str] | None,
    *,
    symmetric: bool,
    repeated: bool,
) -> None:
    """Refuse what :func:`repeat_tests` could not compare, before the surfaces are registered.

    Parameters
    ----------
    individuals, sides : sequence of str, length N, or None
    symmetric : bool
        Asymmetry within each shape is asked for, so individuals need not have several shapes.
    repeated : bool
        Landmarks were placed several times, so they need not either.

    Raises
    ------
    InputError
        If there is nothing to compare.
    """
    if sides is not None and symmetric:
        raise InputError(
            "side: left and right are either shapes of their own (side) or in each shape (symmetry), not both"
        )
    if sides is not None and individuals is None:
        raise InputError(
            "side: sides are compared within individuals; name their column (individuals)"
        )
    if individuals is not None and sides is not None:
        with_both_sides(individuals, sides)
    elif individuals is not None and not symmetric and not repeated:
        check_repeats(individuals)


def repeat_tests(
    points: FloatArray,
    individuals: Sequence[str],
    sides: Sequence[str] | None,
    *,
    units: Sequence[str] | None = None,
    permutations: int,
    seed: int,
) -> tuple[dict[str, Rows], list[Note]]:
    """Compare left and right where ``sides`` are given, and repeated measurements where there are any.

    Parameters
    ----------
    points : ndarray, shape (N, k, 3)
        Surfaces, or landmarks, of which those of one side are mirrored already.
    individuals, sides : sequence of str, length N
        As in :func:`collalign.analysis.paired_sides.paired_sides`.
    units : sequence of str, length N, optional
        What was measured again; by default individuals, or each side of them.
    permutations, seed : int
        Of every test.

    Returns
    -------
    tables : dict of str to rows
        ``sides`` and ``asymmetry``; ``measurement_error`` and ``repeats``.
    notes : list of Note
        The results in words, and whose sides are lacking.
    """
    tables, notes = dict[str, Rows](), list[Note]()
    measured = list(individuals)
    if sides is not None:
        found = paired_sides(points, individuals, sides, permutations=permutations, seed=seed)
        tables |= _side_tables(found)
        notes += _side_notes(found)
        measured = [
            f"{who} {side}" if who and side else ""
            for who, side in zip(individuals, sides, strict=True)
        ]
    measured = measured if units is None else list(units)
    known = [unit for unit in measured if unit]
    if 1 < len({*known}) < len(known):
        error = measurement_error(points, measured, permutations=permutations, seed=seed)
        tables |= _error_tables(error)
        notes.append(_error_note(error))
    return tables, notes


def _side_tables(found: PairedSides) -> dict[str, Rows]:
    numbers = zip(
        found.individuals, found.asymmetry.tolist(), found.fluctuating.tolist(), strict=True
    )
    return {
        "sides": symmetry_rows(found.anova),
        "asymmetry": [["individual", "asymmetry", "fluctuating"], *map(list, numbers)],
    }


def _side_notes(found: PairedSides) -> list[Note]:
    rows = {row.effect: row for row in found.anova}
    total = rows["total"].sum_of_squares
    values: dict[str, Value] = {
        "first": found.sides[0],
        "second": found.sides[1],
        "num": len(found.individuals),
        "p": rows[SIDE].p,
        **{
            name: rows[effect].sum_of_squares / total if total > 0 else float("nan")
            for name, effect in (
                ("individuals", INDIVIDUAL),
                ("directional", SIDE),
                ("fluctuating", INTERACTION),
            )
        },
    }
    notes = [Note("sides-compared", values=values)]
    if found.left_out:
        notes.append(Note("sides-lacking", values={"individuals": found.left_out}))
    return notes


def _error_tables(error: MeasurementError) -> dict[str, Rows]:
    numbers = zip(error.individuals, error.counts.tolist(), error.spreads.tolist(), strict=True)
    head, *rows = symmetry_rows(error.anova)
    shares = [error.repeatability, "", ""]
    return {
        "measurement_error": [
            [*head, "repeatability"],
            *([*row, share] for row, share in zip(rows, shares, strict=True)),
        ],
        "repeats": [["individual", "measurements", "spread"], *map(list, numbers)],
    }


def _error_note(error: MeasurementError) -> Note:
    return Note(
        "measured-again",
        values={
            "num": len(error.individuals),
            "measurements": int(error.counts.sum()),
            "repeatability": error.repeatability,
            "r2": error.r2,
        },
    )
