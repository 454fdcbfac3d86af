"""Where the original files of a result are now, when they are not where they were aligned."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from data_tools.errors import InputError
from data_tools.io.files import readable_stem
from data_tools.io.listing import READERS, hash_shape, parts_of
from data_tools.notes import listed


def is_there(file: str) -> bool:
    """Return whether a shape's file, or the files of its parts, can be found; not so for a shape from memory."""
    try:
        return bool(file) and (Path(file).is_file() or bool(parts_of(file)))
    except InputError:
        return False


def missing_files(files: Sequence[str]) -> list[str]:
    """Return the files that are not where they were; a shape from memory has none."""
    return [file for file in files if file and not is_there(file)]


def find_files(
    names: Sequence[str], files: Sequence[str], digests: Sequence[str], folder: Path | str
) -> tuple[str, ...]:
    """Return where files are now: in a folder, by their names and as far as there are any by their own folders.

    A file that has none of these is looked for by its content in the folder and those in it: it was renamed.

    Parameters
    ----------
    names : sequence of str, length N
        Shapes that came from memory may have been saved there under their names.
    files : sequence of str, length N
        Where the shapes were read from; empty for shapes from memory.
    digests : sequence of str, length N
        Of the files' contents.
    folder : path

    Returns
    -------
    tuple of str
        A file that the folder does not hold stays where it was.

    Raises
    ------
    InputError
        If the folder holds none of the files, or the same file would stand for two shapes.
    """
    place = Path(folder)
    found = [_found(name, file, place) for name, file in zip(names, files, strict=True)]
    if not all(found) and place.is_dir():
        renamed = renamed_files(place, {*digests})
        found = [one or renamed.get(of, "") for one, of in zip(found, digests, strict=True)]
    if not any(found):
        wanted = [Path(re.split(r"[\\/]", file)[-1]).name for file in files if file] or list(names)
        raise InputError(
            f"sources: {place} holds none of the files that were aligned ({listed(wanted)})"
        )
    known = [one for one in found if one]
    if len(set(known)) < len(known):
        twice = next(one for one in known if known.count(one) > 1)
        raise InputError(
            f"sources: {twice} would stand for several shapes; name the folder that holds their folders as they were"
        )
    return tuple(new or old for new, old in zip(found, files, strict=True))


def renamed_files(folder: Path, digests: Collection[str]) -> dict[str, str]:
    """Return the shape files of some contents, by digest, in a folder and those in it; of several alike the first."""
    found = dict[str, str]()
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in READERS and path.is_file():
            with suppress(InputError):
                digest = hash_shape(path)
                if digest in digests:
                    found.setdefault(digest, str(path))
    return found


def _found(name: str, file: str, folder: Path) -> str:
    """Return one file in a folder, or nothing."""
    if not file:
        called = (one for one in folder.glob("*") if readable_stem(one) == name)
        saved = sorted(one for one in called if one.suffix.lower() in READERS)
        return str(saved[0]) if saved else ""
    parts = [part for part in re.split(r"[\\/]", file) if part not in ("", "..")]
    places = [folder.joinpath(*parts[-num:]) for num in range(len(parts), 0, -1)]
    return next((str(place) for place in places if is_there(str(place))), "")
