"""Landmark files of several templates, and the files of curves and patches beside them."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypedDict

import numpy as np

from data_tools.checks import check_count
from data_tools.errors import InputError
from data_tools.landmarks.landmark_files import Landmarks, read_semilandmarks, specimen_of
from data_tools.landmarks.landmark_tables import read_specimens


@dataclass(frozen=True, kw_only=True)
class SemilandmarkRequest:
    """Which semilandmarks are wanted beside the landmarks.

    Parameters
    ----------
    curves : tuple of Path
        Files whose points, in their order, are a curve: RIM/A.fcsv is the curve RIM of the shape called A.
    patches : tuple of Path
        Files whose points are semilandmarks of a patch of the surface, called likewise.
    curve_points : int, optional
        Evenly spaced semilandmarks on every curve; by default so many as the first curve has points.
    surface_points : int
        Semilandmarks spread evenly over the mean surface and carried to all shapes, templates too.

    Raises
    ------
    OptionsError
        If a number is impossible.
    """

    curves: tuple[Path, ...] = ()
    patches: tuple[Path, ...] = ()
    curve_points: int | None = None
    surface_points: int = 0

    def __post_init__(self) -> None:
        check_count("surface_points", self.surface_points, lower=0)
        if self.curve_points is not None:
            check_count("curve_points", self.curve_points, lower=2)


class SemilandmarkKeywords(TypedDict, total=False):
    """The fields of :class:`SemilandmarkRequest` as keywords."""

    curves: Sequence[str | Path]
    patches: Sequence[str | Path]
    curve_points: int | None
    surface_points: int


_LOG = logging.getLogger(__name__)


def read_templates(paths: Sequence[str | Path], names: Sequence[str]) -> dict[str, Landmarks]:
    """Read landmark files by the shapes that they belong to.

    Parameters
    ----------
    paths : sequence of path
        A file belongs to the shape that it is called like; one of several specimens (TPS, NTS, morphologika) to those
        that it names, by name or by file; ``SHAPE=FILE`` to that shape.
    names : sequence of str
        Of all shapes; other specimens of a file of several are left aside with a warning.

    Raises
    ------
    InputError
        If a file cannot be read, belongs to none or ``SHAPE=FILE`` holds several, or two belong to one shape.
    """
    read: dict[str, Landmarks] = {}
    for given in paths:
        shape, path = shape_of(given)
        found = read_specimens(path)
        if shape is not None and len(found) > 1:
            raise InputError(f"{path}: holds {len(found)} specimens, expected that of {shape!r} alone")
        if shape is not None:
            found = dict(zip([shape], found.values(), strict=True))
        elif len(found) > 1:
            known = {Path(name).stem: name for name in found} | {name: name for name in found}
            found = {name: found[known[name]] for name in names if name in known}
            if not found:
                raise InputError(f"{path}: none of its specimens ({', '.join(known)}) is a shape of the collection")
            if others := {*known.values()} - {known[name] for name in found}:
                _LOG.warning("%s: left aside, no shapes of the collection: %s", path, ", ".join(sorted(others)))
        elif not {*found} & {*names}:
            found = dict(zip([specimen_of(path)], found.values(), strict=True))
        if twice := sorted(found.keys() & read.keys()):
            raise InputError(f"{path}: a second landmark file of the specimen {twice[0]!r}")
        read |= found
    return read


def shape_of(given: str | Path) -> tuple[str | None, Path]:
    """Return the shape that ``SHAPE=FILE`` names, None where only a file is given, and the file."""
    shape, sign, file = str(given).partition("=")
    return (shape, Path(file)) if sign and not Path(given).exists() else (None, Path(given))


def with_semilandmarks(given: Mapping[str, Landmarks], wanted: SemilandmarkRequest) -> dict[str, Landmarks]:
    """Return landmarks with the curves and patches of files of their own, of specimens without landmarks as well."""
    found = dict(given)
    kinds: list[tuple[Literal["curve", "patch"], Sequence[str | Path]]] = [
        ("curve", wanted.curves),
        ("patch", wanted.patches),
    ]
    for kind, paths in kinds:
        for path in paths:
            shape, path = shape_of(path)
            name = shape or specimen_of(path)
            marks = found.get(name, Landmarks(labels=(), points=np.empty((0, 3))))
            more = (*marks.semilandmarks, read_semilandmarks(path, kind))
            found[name] = replace(marks, semilandmarks=more)
    return found
