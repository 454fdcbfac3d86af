"""A folder in which a run has to name every entry, or to align it; what each reader refuses is tested there."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions, align_collection
from data_tools.datasets.synthetic_shapes import crown
from data_tools.errors import printable
from data_tools.io.listing import READERS
from data_tools.io.shapes import write_mesh
from data_tools.options import SamplingOptions

NUM_GOOD = 3
OPTIONS = AlignOptions(
    sampling=SamplingOptions(num_points=12, num_dense_points=0), pairs="sparse", refine=False
)
#: Names that are no text, long, empty stems, commands and markup.
NAMES = (
    *(
        "x" * 250 + ".ply",
        "=cmd.ply",
        "-rf.ply",
        "$(id).ply",
        "<b>.ply",
        "a\nb.ply",
        "a\\b.ply",
        "%s%n.ply",
        " .ply",
    ),
    *(
        "CON.ply",
        "é.PLY",
        os.fsdecode(b"\xff\xfe.ply"),
        "a.ply.ply",
        "a..ply",
        "'; DROP TABLE shapes;.ply",
    ),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bad") / "shapes"
    for i in range(NUM_GOOD):
        write_mesh(path / f"good{i}.ply", crown(np.random.default_rng(i), num_vertices=80))
    for name in (*NAMES, *(f"nonsense{suffix}" for suffix in READERS)):
        with open(os.fsencode(path) + b"/" + os.fsencode(name), "wb") as stream:
            stream.write(b"ply\nnonsense")
    os.mkfifo(path / "pipe.ply")
    (path / "folder.ply").mkdir()
    for name, target in (
        ("dangling.ply", "nowhere"),
        ("loop.ply", "loop.ply"),
        ("zero.ply", "/dev/zero"),
    ):
        (path / name).symlink_to(target)
    with (path / "terabyte.ply").open("wb") as stream:
        stream.truncate(10**12)
    return path


@pytest.fixture(scope="module")
def collection(folder):
    return align_collection(
        folder,
        options=OPTIONS,
        run=RunOptions(memory_limit_gib=4.0),
        include=["nonsense.*"],
        progress=False,
    )


def unaccounted(folder, collection):
    """Return the entries of a folder that a result says nothing about."""
    told = {Path(file).name for file in collection.files} | {
        item.file for item in collection.excluded
    }
    readable = {
        os.fsencode(entry).decode("utf-8", "backslashreplace"): entry
        for entry in os.listdir(folder)
    }
    told |= set(collection.run.skipped)
    return {name for name, entry in readable.items() if not {name, entry, printable(name)} & told}


def test_every_bad_input_is_named_or_aligned(folder, collection, tmp_path):
    assert not unaccounted(folder, collection)
    assert collection.names == tuple(f"good{i}" for i in range(NUM_GOOD))
    assert len(collection.excluded) == len(NAMES) + len(READERS) + 1
    assert all(
        len(item.reason) > 10 and "Traceback" not in item.reason for item in collection.excluded
    )
    assert not [
        item for item in collection.excluded if "time limit" in item.reason or "died" in item.reason
    ]
    collection.save(tmp_path / "out")


def test_an_input_that_is_passed_over_is_noticed(folder, collection):
    forgotten = collection.excluded[7].file
    short = dataclasses.replace(
        collection, excluded=tuple(e for e in collection.excluded if e.file != forgotten)
    )
    assert len(unaccounted(folder, short)) == 1
