"""Where results come from: records of tools, the command that makes a result again, and words for a paper."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.command_line import COMMAND, json_types, now
from collalign.options import AlignOptions
from collalign.output.collection_data import CollectionData
from collalign.products.trust import DOUBT
from collalign.version import __version__
from data_tools.errors import InputError
from data_tools.io.files import composed, read_text, write_atomic
from data_tools.io.listing import parts_of
from data_tools.io.objects import list_shapes
from data_tools.io.output_folder import OutputFolder
from data_tools.notes import percent


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
    text = json.dumps(json_types(record), indent=1)
    write_atomic(output.stage(record_name(tool)), text.encode("utf-8", "backslashreplace"))


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


_MARON = (
    "Maron H, Dym N, Kezurer I, Kovalsky S, Lipman Y (2016) Point registration via efficient convex relaxation. ACM "
    "Transactions on Graphics 35(4):73. doi:10.1145/2897824.2925913"
)
_GOODALL = (
    "Goodall C (1991) Procrustes methods in the statistical analysis of shape. Journal of the Royal Statistical "
    "Society B 53:285-339."
)
_RRPP = (
    "Collyer ML, Adams DC (2018) RRPP: an R package for fitting linear models to high-dimensional data using "
    "residual randomization. Methods in Ecology and Evolution 9:1772-1779. doi:10.1111/2041-210X.13029"
)


def methods_paragraph(collection: CollectionData) -> str:
    """Return what a methods section says of an alignment, and of the tools run in its folder, with references.

    Every figure is of the result; what was not done is not mentioned.

    Parameters
    ----------
    collection : CollectionData
        Just made, or loaded; of the folder of a loaded one the records of tools are read as well.
    """
    sentences, references = [*_alignment(collection), *_confidence(collection)], [_MARON]
    for sentence, own in () if collection.folder is None else _of_tools(collection.folder):
        sentences.append(sentence)
        references += own
    listed = "\n".join(f"  {one}" for one in dict.fromkeys(references))
    return f"{' '.join(sentences)}\n\nReferences\n{listed}"


def _alignment(collection: CollectionData) -> list[str]:
    options, num = collection.options, len(collection)
    version = collection.run.versions.get("collalign", "")
    date = f" on {collection.run.date[:10]}" if collection.run.date else ""
    sentences = [
        f"We aligned {num} surfaces with collalign {version}{date} (Maron et al. 2016). Each was sampled at "
        f"{collection.samples.shape[1]} points, {len(collection.pairs)} pairs of surfaces were matched, and their "
        f"rotations were synchronized to one consistent set (method: {options.synchronization}; seed {options.seed})."
    ]
    sizes = {"rigid": "Sizes were kept", "similarity": "Shapes were scaled to a common size"}
    sentences.append(f"{sizes.get(options.scaling, f'Scaling was {options.scaling}')}.")
    reflected = int(collection.reflected.sum())
    if collection.group == "O":
        sentences.append(
            f"{reflected} of {num} specimens were reflected to match the side of the others."
        )
    else:
        sentences.append("No specimen was reflected.")
    num_incomplete = sum(not one.is_stranger for one in collection.incomplete)
    if num_incomplete:
        sentences.append(
            f"{num_incomplete} specimens were incomplete and aligned on what is preserved."
        )
    if collection.excluded:
        sentences.append(f"{len(collection.excluded)} files or pairs were left out.")
    return sentences


def _confidence(collection: CollectionData) -> list[str]:
    known = np.isfinite(collection.confidence)
    if not known.any():
        return []
    sure, num = int((collection.confidence >= DOUBT).sum()), len(collection)
    sentences = [
        f"The estimated confidence was at least {percent(DOUBT)} for {sure} of {num} poses."
    ]
    if collection.by_hand:
        set_by_hand = len(collection.by_hand)
        sentences.append(
            f"{set_by_hand} of {num} poses {'was' if set_by_hand == 1 else 'were'} set by hand."
        )
    return sentences


def _variation(options: Mapping[str, Any]) -> str:
    tests = options["tests"]
    model = f" The model shape ~ {tests['model']} was tested." if tests["model"] else ""
    kind = "sequential" if tests["sums_of_squares"] == "I" else "marginal"
    sums, drawn = tests["sums_of_squares"], tests["permutations"]
    return (
        f"{options['num_shapes']} surfaces were brought into dense correspondence ({options['num_vertices']} "
        "vertices), superimposed at unit centroid size, and compared by Procrustes ANOVA (Goodall 1991) with "
        f"{kind} sums of squares (type {sums}) and {drawn} random permutations of residuals (Collyer and Adams 2018; "
        f"seed {tests['seed']}).{model}"
    )


def _transfer(options: Mapping[str, Any]) -> str:
    templates = options["templates"]
    return (
        f"{options['num_landmarks']} landmarks were carried to all specimens from {len(templates)} "
        f"{'template' if len(templates) == 1 else 'templates'} ({', '.join(templates)})."
    )


#: What a methods section says of a tool by the options of its record, and the references of it.
_TOOLS: dict[str, tuple[Callable[[Mapping[str, Any]], str], tuple[str, ...]]] = {
    "variation": (_variation, (_GOODALL, _RRPP)),
    "transfer": (_transfer, ()),
}


def _of_tools(folder: Path) -> list[tuple[str, tuple[str, ...]]]:
    """Return what the records of tools in the folders of a result say; what cannot be read says nothing."""
    found = []
    for tool, (describe, references) in _TOOLS.items():
        for path in sorted(folder.glob(f"*/{record_name(tool)}")):
            with suppress(ValueError, LookupError, TypeError, RecursionError):
                found.append((describe(json.loads(read_text(path))["options"]), references))
    return found
