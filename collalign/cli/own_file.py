"""What the caller knows of shapes and pairs, from files: ``collalign align --own FILE --marks FILE``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign.console.messages import warn
from collalign.landmarks.on_surface import place_templates
from collalign.landmarks.templates import read_templates, shape_of
from collalign.products.own import Own
from collalign.wording import note_text
from data_tools.errors import CollalignError, InputError
from data_tools.io.files import open_regular, read_text
from data_tools.io.listing import FolderListing
from data_tools.io.source import MAX_FILE_BYTES
from data_tools.options import CleaningOptions

_KEYS = {"pairs", "samples", "invariants", "invariants_weight"}


def read_own(path: Path) -> tuple[Own, set[Path]]:
    """Return what a JSON file says of pairs and samples, with the invariants of a folder that it names.

    ``{"pairs": [{"target": A, "source": B, "rotations": [R], "vertices": [[0, 7]], "weight": 1}], "samples":
    {A: [0]}, "invariants": FOLDER, "invariants_weight": 0.4}``, each of which may be missing; ``vertices`` match
    those of A's file and of B's, and FOLDER, relative to the file, holds ``A.npy``.

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
        content = json.loads(read_text(path))
        if unknown := sorted(set(content) - _KEYS):
            raise InputError(f"there is no entry {unknown[0]!r}, only {', '.join(sorted(_KEYS))}")
        pairs = [((one["target"], one["source"]), one) for one in content.pop("pairs", [])]
        folder = path.parent / content.pop("invariants") if "invariants" in content else None
        own = Own(
            candidates={pair: one["rotations"] for pair, one in pairs if "rotations" in one},
            correspondences={pair: one["vertices"] for pair, one in pairs if "vertices" in one},
            pair_weights={pair: one["weight"] for pair, one in pairs if "weight" in one},
            invariants={} if folder is None else _arrays(folder),
            **content,
        )
    except (
        CollalignError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
        RecursionError,
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
        As :func:`collalign.landmarks.templates.read_templates` takes it.
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


def _arrays(folder: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a folder by the names of their shapes."""
    found = {}
    for file in sorted(folder.rglob("*.npy")):
        try:
            with open_regular(file, MAX_FILE_BYTES) as stream:
                found[file.relative_to(folder).with_suffix("").as_posix()] = np.load(
                    stream, allow_pickle=False
                )
        except (OSError, ValueError, EOFError) as error:
            raise InputError(f"invariants: {file} cannot be read ({error})") from error
    if not found:
        raise InputError(f"invariants: {folder} holds no NAME.npy")
    return found
