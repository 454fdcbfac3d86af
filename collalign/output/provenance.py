"""Where results come from: records of tools, and the command that makes a result again."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from collalign.engine.command_line import COMMAND, json_types, now
from collalign.options import AlignOptions
from collalign.output.collection_data import CollectionData
from collalign.version import __version__
from data_tools.errors import InputError
from data_tools.io.files import composed
from data_tools.io.listing import parts_of
from data_tools.io.objects import list_shapes
from data_tools.io.output_folder import OutputFolder

#: What the names of the records of all tools have in common.
RECORDS = "run-*.json"


def record_name(tool: str) -> str:
    """Return the name of the record of a tool, by which several of one folder differ."""
    return f"run-{tool.replace(' ', '-')}.json"


def write_tool_record(output: OutputFolder, tool: str, options: Mapping[str, Any]) -> None:
    """Stage the record of a tool.

    Parameters
    ----------
    output : OutputFolder
    tool : str
        The command, and the format if files of several may lie in one folder.
    options : mapping of str to Any
        What decided the files, templates included.
    """
    record = {
        "tool": tool,
        "command": COMMAND.get(),
        "version": __version__,
        "date": now(),
        "options": options,
    }
    output.stage_text(json.dumps(json_types(record), indent=1), record_name(tool))


def result_place(collection: CollectionData, to: Path) -> str:
    """Return where a loaded result is, seen from a folder, for a record there; empty for one of memory.

    So both may move together.
    """
    if collection.folder is None:
        return ""
    try:
        return Path(os.path.relpath(collection.folder.resolve(), to.resolve())).as_posix()
    except ValueError:  # on another drive
        return str(collection.folder.resolve())


def shape_words(collection: CollectionData) -> tuple[list[str], list[str]]:
    """Return the words that give the shapes of a result, and the names of those there that were left out.

    Raises
    ------
    InputError
        If no command can be given them: shapes came from memory, are not called like their files or have vanished.
    """
    if collection.own:
        raise InputError(
            f"the result was made with {', '.join(collection.own)} of the caller's own"
        )
    files = collection.source_files()
    parts = any(parts_of(file) for file in files)
    depths = [path.count("/") for path in collection.relative_paths]
    folders = {file.parents[depth] for file, depth in zip(files, depths, strict=True)}
    places, recursive = [*(folders if len(folders) == 1 else files)], any(depths) and not parts
    listing = list_shapes(places, recursive=recursive, parts=parts)
    if not {*files} <= {*listing.files}:  # tables beside meshes, say, which were included
        places, recursive = [*files], False
        listing = list_shapes(places, parts=parts)
    listed = dict(zip(listing.names, listing.files, strict=True))
    if any(listed.get(name) != file for name, file in zip(collection.names, files, strict=True)):
        raise InputError(
            "the shapes are not called like their files; go on where they are called as they were"
        )
    left_out = (composed(str(Path(item.file).with_suffix(""))) for item in collection.excluded)
    known = {*collection.names, *left_out}
    how = ["--parts"] * parts + ["--recursive"] * recursive
    return [*map(str, places), *how], [name for name in listing.names if name not in known]


def option_words(options: Any, default: Any = AlignOptions(), before: str = "--") -> Iterator[str]:  # noqa: B008
    """Yield the words that give options where they are not as by default."""
    for one in fields(options):
        value, usual = getattr(options, one.name), getattr(default, one.name)
        word = f"{before}{one.name.replace('_', '-')}"
        if is_dataclass(value):
            yield from option_words(value, usual, f"{word}.")
        elif value != usual:
            yield f"{word}={value}"
