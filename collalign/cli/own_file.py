"""What the caller knows of shapes and pairs, from files: ``collalign align --own FILE --marks FILE``."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from collalign.console.messages import warn
from collalign.products.own import Own
from collalign.template_landmarks.on_surface import place_templates
from collalign.template_landmarks.templates import read_templates, shape_of
from collalign.wording import note_text
from data_tools.errors import CollalignError, InputError
from data_tools.io.archives import load_array
from data_tools.io.files import open_regular, read_text, readable_name
from data_tools.io.listing import FolderListing
from data_tools.io.source import MAX_FILE_BYTES
from data_tools.options import CleaningOptions

_KEYS = {"pairs", "samples", "invariants", "invariants_weight"}


def read_own(path: Path, names: Iterable[str]) -> tuple[Own, set[Path]]:
    """Return what a JSON file says of pairs and samples, with the invariants of a folder that it names.

    ``{"pairs": [{"target": A, "source": B, "rotations": [R], "vertices": [[0, 7]], "weight": 1}], "samples":
    {A: [0]}, "invariants": FOLDER, "invariants_weight": 0.4}``, each of which may be missing; ``vertices`` match
    those of A's file and of B's, and FOLDER, relative to the file, holds ``A.npy``.

    Parameters
    ----------
    path : Path
    names : iterable of str
        The collection's shapes.

    Returns
    -------
    own : Own
    inputs : set of Path
        The file and the folder.

    Raises
    ------
    InputError
        Naming the file, if it is not such a file, or an array cannot be read.
    """
    try:
        content = _content(path)
        if unknown := sorted(set(content) - _KEYS):
            raise InputError(f"there is no entry {unknown[0]!r}, only {', '.join(sorted(_KEYS))}")
        pairs = [((one["target"], one["source"]), one) for one in content.pop("pairs", [])]
        place = content.pop("invariants", None)
        if not isinstance(place, str | None):
            raise InputError("invariants: expected the name of a folder")
        folder = None if place is None else path.parent / place
        own = Own(
            candidates={pair: one["rotations"] for pair, one in pairs if "rotations" in one},
            correspondences={pair: one["vertices"] for pair, one in pairs if "vertices" in one},
            pair_weights={pair: one["weight"] for pair, one in pairs if "weight" in one},
            invariants={} if folder is None else _arrays(folder, names),
            **content,
        )
    except (
        CollalignError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
    ) as error:
        reason = f"no {error} is given" if isinstance(error, KeyError) else str(error)
        raise InputError(f"{path}: {reason.removeprefix(f'{path}: ')}") from error
    return own, {path, *([] if folder is None else [folder])}


def read_marks(
    own: Own, path: Path, listing: FolderListing, cleaning: CleaningOptions
) -> tuple[Own, set[Path]]:
    """Return ``own`` with the landmarks of a file, and the file.

    Parameters
    ----------
    own : Own
    path : Path
        As :func:`collalign.template_landmarks.templates.read_templates` takes it.
    listing : FolderListing
    cleaning : CleaningOptions
        How its files are read.

    Raises
    ------
    InputError
        If it cannot be read, belongs to no shape, or its landmarks do not lie on that shape.
    """
    files = dict(zip(listing.names, listing.files, strict=True))
    placed, notes, _ = place_templates(read_templates([path], listing.names), files, (), cleaning)
    for note in notes:
        warn(note_text(note))
    marks = {
        name: {
            label: point
            for label, point in zip(one.labels, one.points, strict=True)
            if not np.isnan(point).any()
        }
        for name, one in placed.items()
    }
    return replace(own, marks=marks), {shape_of(path)[1]}


def _content(path: Path) -> dict[str, Any]:
    """Return what the file holds."""
    try:
        content = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError(f"not JSON ({error})") from error
    except (ValueError, RecursionError) as error:  # no text, endless numbers or brackets
        raise InputError("not JSON of such knowledge, it is damaged or of another kind") from error
    if not isinstance(content, dict):
        raise InputError(f"expected a JSON object with {', '.join(sorted(_KEYS))}")
    return content


def _arrays(folder: Path, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Return the arrays of shapes, which a folder holds under their names; nothing else in it is opened."""
    found: dict[str, np.ndarray] = {}
    there: dict[Path, dict[str, Path]] = {}
    for name in names:
        place = (folder / f"{name}.npy").parent
        if place not in there:
            there[place] = {readable_name(file): file for file in place.glob("*.npy")}
        file = there[place].get(f"{PurePosixPath(name).name}.npy")
        if file is None:
            continue
        try:
            with open_regular(file, MAX_FILE_BYTES) as stream:
                size = os.fstat(stream.fileno()).st_size
                found[name] = load_array(stream, size, str(file))
        except InputError as error:
            raise InputError(f"invariants: {error}") from error
    if not found:
        raise InputError(
            f"invariants: {folder} holds no NAME.npy of a shape; name the folder that has one for each"
        )
    return found
