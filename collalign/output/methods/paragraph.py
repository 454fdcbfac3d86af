"""What a methods section says of a result and of what was made of it: figures, who was left out, and references."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from collalign.options import ALL, AUTO, NEVER
from collalign.output.collection_data import CollectionData
from collalign.output.evidence_file import EVIDENCE_FILE
from collalign.output.methods.of_tools import TOOLS, Sentence, counted, specimens
from collalign.output.methods.references import MARON, SOFTWARE
from collalign.output.provenance import RECORDS
from collalign.products.trust import DOUBT
from collalign.version import __version__
from data_tools.errors import InputError
from data_tools.io.files import read_text
from data_tools.notes import listed, percent


def methods_paragraph(collection: CollectionData, folder: Path | None = None) -> str:
    """Return what a methods section says of an alignment, and of what was made of it, with references.

    Every figure is of the result; what was not done is not mentioned.

    Parameters
    ----------
    collection : CollectionData
        Just made, or loaded.
    folder : Path, optional
        Of a tool, whose record is told. By default, of a loaded result, the folders in its own.
    """
    said = [*_alignment(collection), *_left_out_by_whom(collection), *_confidence(collection)]
    if folder is not None:
        said += _of_records([folder])
    elif collection.folder is not None:
        said += _of_records(sorted(collection.folder.glob("*/")))
    return _text(said)


def alignment_folder(folder: Path) -> Path:
    """Return the folder of the alignment that a folder of a tool was made from, by the tool's record.

    Parameters
    ----------
    folder : Path
        What ``transfer``, ``variation`` or ``export`` wrote.

    Raises
    ------
    InputError
        If there is no record of a tool, or the alignment is not there any more.
    """
    records = [record for _, record in _records(folder)]
    if not records:
        raise InputError(
            f"{folder}: there is no result. Give the folder that collalign align, transfer, variation or export wrote"
        )
    told = [str(record["options"].get("result", "")) for record in records]
    for place in [*(folder / one for one in told if one), folder.parent]:
        if (place / EVIDENCE_FILE).is_file():
            return place
    named = f" ({listed(list(filter(None, told)))})" if any(told) else ""
    raise InputError(
        f"{folder}: the alignment that it was made from{named} is not there any more. Bring it back to that place, "
        "or into the folder above"
    )


def _text(said: list[Sentence]) -> str:
    sentences = " ".join(sentence for sentence, _ in said)
    references = dict.fromkeys(one for _, needed in said for one in needed)
    listing = "\n".join(f"  {one}" for one in references)
    return f"{sentences}\n\nReferences\n{listing}"


def _alignment(collection: CollectionData) -> list[Sentence]:
    options, num, versions = collection.options, len(collection), collection.run.versions
    version = versions.get("collalign", "")
    date = f" on {collection.run.date[:10]}" if collection.run.date else ""
    libraries = [
        f"{name} {versions[key]}"
        for key, name in (("python", "Python"), ("numpy", "NumPy"), ("scipy", "SciPy"))
        if key in versions
    ]
    beside = f", with {listed(libraries)}" if libraries else ""
    said: list[Sentence] = [
        (
            f"We aligned {num} surfaces with collalign {version}{date}{beside} (The collalign developers; method "
            f"after Maron et al. 2016). Each was sampled at {collection.samples.shape[1]} points, "
            f"{len(collection.pairs)} pairs of surfaces were matched, and their rotations were synchronized to one "
            f"consistent set (method: {options.synchronization}; seed {options.seed}).",
            (SOFTWARE.format(version=version or __version__), MARON),
        )
    ]
    sizes = {"rigid": "Sizes were kept", "similarity": "Shapes were scaled to a common size"}
    said.append((f"{sizes.get(options.scaling, f'Scaling was {options.scaling}')}.", ()))
    reflected = int(collection.reflected.sum())
    if collection.group == "O":
        said.append(
            (
                f"{reflected} of {num} specimens were reflected to match the side of the others.",
                (),
            )
        )
    else:
        said.append(("No specimen was reflected.", ()))
    return said


def _left_out_by_whom(collection: CollectionData) -> list[Sentence]:
    said: list[Sentence] = []
    by_authors = collection.run.left_out
    if by_authors:
        said.append((f"We left out {specimens(by_authors)} beforehand.", ()))
    if collection.excluded:
        files = [one.file for one in collection.excluded]
        said.append(
            (
                f"The program left out {counted(len(files), 'file or pair', 'files or pairs')} that it could not "
                f"use: {listed(files)}.",
                (),
            )
        )
    broken = [collection.names[one.shape] for one in collection.incomplete if not one.is_stranger]
    if broken:
        is_told = collection.options.incomplete not in (AUTO, ALL, NEVER)
        who = "as we had stated" if is_told else "as the program detected"
        were = "specimen was" if len(broken) == 1 else "specimens were"
        said.append(
            (
                f"{len(broken)} {were} incomplete, {who}, and aligned on what is preserved: {listed(broken)}.",
                (),
            )
        )
    return said


def _confidence(collection: CollectionData) -> list[Sentence]:
    known = np.isfinite(collection.confidence)
    if not known.any():
        return []
    sure, num = int((collection.confidence >= DOUBT).sum()), len(collection)
    said = f"The estimated confidence was at least {percent(DOUBT)} for {sure} of {num} poses."
    if by_hand := [*collection.by_hand]:
        were = "was" if len(by_hand) == 1 else "were"
        said += f" {len(by_hand)} of {num} poses {were} set by hand: {listed(by_hand)}."
    return [(said, ())]


def _records(folder: Path) -> list[tuple[str, Mapping[str, Any]]]:
    """Return tools and records of a folder; what cannot be read, or is of a tool of which nothing is said, is not."""
    found = []
    for path in sorted(folder.glob(RECORDS)):
        with suppress(InputError, ValueError, LookupError, TypeError, RecursionError):
            record = json.loads(read_text(path))
            tool = str(record["tool"]).split()[0]
            if tool in TOOLS and isinstance(record["options"], dict):
                found.append((tool, record))
    return found


def _of_records(folders: Iterable[Path]) -> list[Sentence]:
    """Return what the records of tools say, in the order of the work; one that is damaged says nothing."""
    records = [one for folder in folders for one in _records(folder)]
    told = {tool: [record for of, record in records if of == tool] for tool in TOOLS}
    if told["transfer"]:  # which exports its landmarks itself
        told["export"] = []
    said: list[Sentence] = []
    for tool, describe in TOOLS.items():
        for record in told[tool]:
            with suppress(ValueError, LookupError, TypeError):
                said += [*describe(record["options"])]
    return list(dict.fromkeys(said))
