"""Landmark files of several templates, and the files of their curves and patches."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, TypedDict, get_args

import numpy as np

from data_tools.checks import check_choice, check_count
from data_tools.errors import InputError
from data_tools.io.files import composed
from data_tools.landmark_files import Landmarks, read_semilandmarks, specimen_of
from data_tools.landmark_tables import read_specimens
from data_tools.names import match_names, nearest_names, nearly, warn_of_near
from data_tools.notes import listed

#: To where semilandmarks slide, see :func:`collalign.analysis.sliding.slide_semilandmarks`.
Slide: TypeAlias = Literal["bending", "procrustes"]


@dataclass(frozen=True, kw_only=True)
class SemilandmarkRequest:
    """Which semilandmarks are wanted in addition to the landmarks.

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
    slide : {"bending", "procrustes"}, optional
        Slide semilandmarks along their curves and surfaces to where the bending energy of the thin-plate spline from
        the mean is least, or the Procrustes distance.

    Raises
    ------
    OptionsError
        If a number is impossible.
    """

    curves: tuple[Path, ...] = ()
    patches: tuple[Path, ...] = ()
    curve_points: int | None = None
    surface_points: int = 0
    slide: Slide | None = None

    def __post_init__(self) -> None:
        check_count("surface_points", self.surface_points, lower=0)
        if self.curve_points is not None:
            check_count("curve_points", self.curve_points, lower=2)
        if self.slide is not None:
            check_choice("slide", self.slide, get_args(Slide))


class SemilandmarkKeywords(TypedDict, total=False):
    """The fields of :class:`SemilandmarkRequest` as keywords."""

    curves: Sequence[str | Path]
    patches: Sequence[str | Path]
    curve_points: int | None
    surface_points: int
    slide: Slide | None


_LOG = logging.getLogger(__name__)
#: What programs and people add to the name of a specimen for the file of its landmarks.
_WORDS = re.compile(
    r"(?i)[-_ .]+((lms?|lmks?|landmarks?|fiducials?|markups?|points?|pts|coords?|coordinates?)[-_ .]*\d*[-_ .]*)+"
)


def read_templates(paths: Sequence[str | Path], names: Sequence[str]) -> dict[str, Landmarks]:
    """Read landmark files by the shapes that they belong to.

    Parameters
    ----------
    paths : sequence of path
        A file belongs to the shape that it is called like, perhaps with a word for landmarks after the name
        (``A_LM1.mrk.json``); one of several specimens (TPS, NTS, morphologika, a table) to those that it names, by
        name or by file; ``SHAPE=FILE`` to that shape.
    names : sequence of str
        Of all shapes; other specimens of a file of several, and those without any landmark, are left aside with a
        warning.

    Raises
    ------
    InputError
        If a file cannot be read, belongs to none or ``SHAPE=FILE`` holds several, or two belong to one shape.
    """
    read: dict[str, Landmarks] = {}
    for given in paths:
        shape, path = shape_of(given)
        found = read_specimens(path, names)
        if shape is not None and len(found) > 1:
            raise InputError(
                f"{path}: holds {len(found)} specimens, expected that of {shape!r} alone"
            )
        called = match_names(found, names)
        if len(found) == 1 and nearly(called) and specimen_of(path) in names:
            called = {}  # a running number in the file, say, whose name says more
        named = {called[name]: marks for name, marks in found.items() if name in called}
        if len(found) > 1 and not named:
            first = next(iter(found))
            raise InputError(
                f"{path}: none of its specimens ({listed([*found])}) is a shape of the collection"
                f"{nearest_names(first, names)}"
            )
        if shape is not None or not named:
            named = dict(zip([specimen_among(given, names)], found.values(), strict=True))
        else:
            warn_of_near(str(path), called)
        if shape is None and called and (others := {*found} - {*called}):
            _LOG.warning(
                "%s: left aside, no shapes of the collection: %s", path, ", ".join(sorted(others))
            )
        found = named
        bare = [
            name
            for name, marks in found.items()
            if not marks.semilandmarks and np.isnan(marks.points).all()
        ]
        if len(bare) == len(found):
            raise InputError(
                f"{path}: all its landmarks are missing; give a specimen that has some"
            )
        if bare:
            _LOG.warning(
                "%s: left aside, all their landmarks are missing: %s", path, ", ".join(bare)
            )
        found = {name: marks for name, marks in found.items() if name not in bare}
        if twice := sorted(found.keys() & read.keys()):
            raise InputError(f"{path}: a second landmark file of the specimen {twice[0]!r}")
        read |= found
    return read


def shape_of(given: str | Path) -> tuple[str | None, Path]:
    """Return the shape that ``SHAPE=FILE`` names, None where only a file is given, and the file."""
    shape, sign, file = str(given).partition("=")
    return (
        (composed(shape), Path(file)) if sign and not Path(given).exists() else (None, Path(given))
    )


def specimen_among(given: str | Path, names: Sequence[str]) -> str:
    """Return the shape that a landmark file, or ``SHAPE=FILE``, belongs to.

    Raises
    ------
    InputError
        If it is none of these shapes.
    """
    shape, path = shape_of(given)
    name = specimen_of(path) if shape is None else shape
    folder = path.absolute().parent
    asked = (folder / name).as_posix() if shape is None else shape
    ends = [
        at for at in range(len(name) - 1, 0, -1) if shape is None and _WORDS.fullmatch(name, at)
    ]
    for one in (asked, *((folder / name[:at]).as_posix() for at in ends)):
        if called := match_names([one], names):
            if one != asked or nearly(called):
                _LOG.warning("%s: taken as the landmarks of %s, by its name", path, called[one])
            return called[one]
    hint = "" if shape else f" (call the file like its shape, or give it as SHAPE={path.name})"
    advice = nearest_names(name, names) or f"; the collection has {listed(names)}"
    raise InputError(f"{path}: no shape is called {name!r}{hint}{advice}")


def with_semilandmarks(
    given: Mapping[str, Landmarks], wanted: SemilandmarkRequest, names: Sequence[str]
) -> dict[str, Landmarks]:
    """Return landmarks with the curves and patches of files of their own, of specimens without landmarks as well.

    Raises
    ------
    InputError
        If a file cannot be read, or belongs to none of the shapes, which are called ``names``.
    """
    found = dict(given)
    kinds: list[tuple[Literal["curve", "patch"], Sequence[str | Path]]] = [
        ("curve", wanted.curves),
        ("patch", wanted.patches),
    ]
    for kind, paths in kinds:
        for path in paths:
            name = specimen_among(path, names)
            marks = found.get(name, Landmarks(labels=(), points=np.empty((0, 3))))
            more = (*marks.semilandmarks, read_semilandmarks(shape_of(path)[1], kind))
            found[name] = replace(marks, semilandmarks=more)
    return found
