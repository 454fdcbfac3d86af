"""300 bad inputs in one folder, by hand and by random damage: ``python -m tests.bad_inputs`` looks for each.

A run has to name every one of them, with a reason or as no shape, or to align it.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from collalign import AlignOptions, RunOptions, align_collection
from data_tools.datasets.synthetic_shapes import crown
from data_tools.errors import printable
from data_tools.io.shapes import write_mesh
from data_tools.options import SamplingOptions
from tests.data_tools.io.test_points import MALFORMED as POINTS
from tests.data_tools.io.test_shapes import MALFORMED as MESHES
from tests.data_tools.io.test_text_tables import AMBIGUOUS
from tests.fuzz.harness import damaged
from tests.fuzz.seeds import shape_files

NUM_GOOD, NUM_DAMAGED = 3, 200
OPTIONS = AlignOptions(sampling=SamplingOptions(num_points=12, num_dense_points=0), pairs="sparse", refine=False)

#: Contents by suffix beside those that the tests of the readers name; each is bad in its own way.
CONTENTS = {
    "glb": [
        "glTF",
        "glTF\x02\x00\x00\x00",
        "glTF\x02\x00\x00\x00\xff\xff\xff\x7f",
        "glTF\x01\x00\x00\x00\x00\x00\x00\x00",
    ],
    "txt": [
        "hello\n",
        "\n\n\n",
        "\t\t\t\n",
        "\ufeff",
        "0x10 0x20 0x30\n0x1 0x2 0x3\n",
        "1 2 3\n\x004 5 6\n",
        "l'été\n",
    ],
    "npz": ["PK\x03\x04", "PK\x05\x06" + "\x00" * 18, "\x93NUMPY\x01\x00"],
}


def write_bad_inputs(folder, *, every=1):
    """Write all bad inputs (or each so many-th) and some good ones into a folder; returns how many are bad."""
    folder.mkdir(parents=True)
    for i in range(NUM_GOOD):
        write_mesh(folder / f"good{i}.ply", crown(np.random.default_rng(i), num_vertices=80))
    files = {
        f"hand{number:02d}.{suffix}": content.encode("utf-8" if suffix == "txt" else "latin-1")
        for suffix, contents in CONTENTS.items()
        for number, content in enumerate(contents)
    }
    files |= {name: content.encode() for name, content, _ in (*MESHES, *POINTS)}
    files |= {f"table{number:02d}.csv": content.encode() for number, (content, _) in enumerate(AMBIGUOUS)}
    with tempfile.TemporaryDirectory() as seeds:
        good = shape_files(Path(seeds))
    for number in range(NUM_DAMAGED):
        name, content = damaged(good, 0, number)
        files[f"damaged{number:03d}-{name}"] = content
    files |= _names()
    chosen = dict(list(files.items())[::every])
    for name, content in chosen.items():
        with open(os.fsencode(folder) + b"/" + os.fsencode(name), "wb") as stream:
            stream.write(content)
    return len(chosen) + _special(folder)


def unaccounted(folder, collection):
    """Return the entries of a folder that a result says nothing about."""
    told = {Path(file).name for file in collection.files} | {item.file for item in collection.excluded}
    readable = {os.fsencode(entry).decode("utf-8", "backslashreplace"): entry for entry in os.listdir(folder)}
    told |= set(collection.run.skipped)
    return {name for name, entry in readable.items() if not {name, entry, printable(name)} & told}


def _names():
    """Names that are no text, long, empty stems, commands and markup; the contents are bad as well."""
    names = [
        "x" * 250 + ".ply",
        "=cmd.ply",
        "-rf.ply",
        "$(id).ply",
        "<b>.ply",
        "a\nb.ply",
        "a\\b.ply",
        "%s%n.ply",
        " .ply",
    ]
    names += ["CON.ply", "é.PLY", os.fsdecode(b"\xff\xfe.ply"), "a.ply.ply", "a..ply", "'; DROP TABLE shapes;.ply"]
    return dict.fromkeys(names, b"ply\nnonsense")


def _special(folder):
    """Entries that are no plain files, and a file whose size is a trap; returns their number."""
    num_before = len(list(folder.iterdir()))
    os.mkfifo(folder / "pipe.ply")
    (folder / "folder.ply").mkdir()
    (folder / "dangling.ply").symlink_to("nowhere")
    (folder / "loop.ply").symlink_to("loop.ply")
    (folder / "zero.ply").symlink_to("/dev/zero")
    with (folder / "terabyte.ply").open("wb") as stream:
        stream.truncate(10**12)
    return len(list(folder.iterdir())) - num_before


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=-1)
    options = parser.parse_args()
    start_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "shapes"
        num = write_bad_inputs(folder)
        run = RunOptions(jobs=options.jobs, shape_time_limit_s=60.0, memory_limit_gib=4.0)
        collection = align_collection(folder, options=OPTIONS, run=run)
        collection.save(Path(place) / "out")
        missing = unaccounted(folder, collection)
    print(
        f"{num} bad inputs: {len(collection.excluded)} left out by name, {len(collection.names) - NUM_GOOD} aligned, "
        f"{len(collection.run.skipped)} skipped as no shapes; {len(missing)} unaccounted for; "
        f"{time.perf_counter() - start_s:.0f} s"
    )
    for name in sorted(missing):
        print(f"  {name!r}")
    return int(bool(missing))


if __name__ == "__main__":
    raise SystemExit(main())
