"""Mistakes in labels and sizes, and what is left out, are said: by the command line, and in Python."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import load
from collalign.products.trust import DOUBT
from collalign.statistics import write_surface_variation
from data_tools.datasets.synthetic import deformed_family, mirrored
from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.shapes import write_ply
from data_tools.rotations import random_rotation
from tests.commands import read_json, read_rows, run_command
from tests.notes import codes, only

NUM = 10
#: Positions of the shapes of the other side, and of the one in twice its size.
MIRRORED, DOUBLED = (1, 4, 7), 6
NAMES = tuple(f"Tooth_{at + 1:03d}" for at in range(NUM))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Left and right blobs, one of them in twice its size, aligned with labels by the command line."""
    rng, place = np.random.default_rng(5), tmp_path_factory.mktemp("labels")
    base = blob(rng, num_vertices=300)
    base = replace(base, vertices=base.vertices * [1.6, 1.0, 0.75])
    (place / "shapes").mkdir()
    for at, shape in enumerate(deformed_family(base, NUM, rng, rms=0.03)):
        own = mirrored(shape) if at in MIRRORED else shape
        size = 2.0 if at == DOUBLED else 1.0
        points = size * own.vertices @ random_rotation(rng).T
        write_ply(place / "shapes" / f"{NAMES[at]}.ply", points, own.faces)
    rows = [
        [f"tooth {at + 1}", "LR"[(at in MIRRORED) != (at == 3)], [*"fm"][at % 2], 3 * at]
        for at in range(NUM)
    ]
    write(place / "labels.csv", rows)
    said = run_command(
        *("align", place / "shapes", "--out", place / "out", "--labels", place / "labels.csv"),
        *("--group", "O", "--sampling.num-points", 48, "--sampling.num-dense-points", 200),
        *("--jobs", 1),
    )
    assert "Tooth_001 (row tooth 1)" in said.err
    assert "labels and surfaces contradict each other for Tooth_004 ('R'). 9 of 10" in said.out
    return place / "out"


def write(path, rows):
    path.write_text(
        "".join(f"{','.join(map(str, row))}\n" for row in (["name", "side", "sex", "age"], *rows))
    )
    return path


def table(result, path, **cells):
    """Write the labels of a result with other cells (``age_3="6O"``), and return the path."""
    columns = {name: [*values] for name, values in load(result).labels.items()}
    for cell, value in cells.items():
        column, _, at = cell.partition("_")
        columns[column][int(at)] = value
    return write(path, zip(NAMES, *(columns[name] for name in ("side", "sex", "age")), strict=True))


def test_a_wrong_side_and_a_double_size_are_in_the_result(result):
    collection = load(result)
    assert collection.labels["age"] == tuple(str(3 * at) for at in range(NUM))
    (side,) = only(collection.notes, "labels-of-sides").shapes
    assert side == NAMES[3]
    apart = only(collection.notes, "size-apart")
    assert apart.shapes == (NAMES[DOUBLED],)
    assert apart.values["times"][0] == pytest.approx(2.0, rel=0.1)
    records = read_json(result / "alignment.json")["notes"]
    texts = {record["code"]: record["text"] for record in records}
    assert "2.0" in texts["size-apart"] or "diameter" in texts["size-apart"]
    assert "labels-taken-as" in texts


def test_a_table_of_which_no_row_fits_ends_every_command(result, tmp_path):
    strange = write(tmp_path / "strange.csv", [["bone7", "L", "f", 1]])
    for words in (("variation", result), ("variation", result, "--classify", "sex")):
        said = run_command(*words, "--labels", strange, ends=2)
        assert "none of its rows belongs to a shape" in said.err
    shapes = result.parent / "shapes"
    run_command("align", shapes, "--out", tmp_path / "out", "--labels", strange, ends=2)
    assert not (tmp_path / "out").exists()


def test_what_is_left_out_is_compared_with_what_counts(result, tmp_path):
    """On the page, in the record and as a table; names that nearly agree are excluded, and said."""
    collection = load(result)
    unsure = np.where(np.arange(NUM) < 3, 0.5 * DOUBT, 1.0)
    typed = table(result, tmp_path / "typed.csv", sex_9="M ", age_9="")
    found = write_surface_variation(
        replace(collection, confidence=unsure),
        tmp_path / "some",
        labels=typed,
        exclude=["tooth 10"],
    )
    age = next(note for note in found.notes if note.values.get("column") == "age")
    assert (age.code, age.values["range"]) == ("left-out-differ", (0.0, 24.0))
    assert age.values["range_counted"] == (9.0, 24.0)
    offer = only(found.notes, "left-out-doubtful")
    assert (offer.shapes, offer.values["num"]) == (NAMES[:3], 9)
    assert only(found.notes, "labels-misspelt").values["groups"] == ("M",)
    assert "labels-taken-as" not in codes(found.notes), "that was another table"
    record = read_json(tmp_path / "some" / "run-variation.json")["options"]
    assert {"left-out-differ", "labels-of-sides", "size-apart"} <= {
        one["code"] for one in record["notes"]
    }
    page = (tmp_path / "some" / "variation.html").read_text("utf-8")
    assert "The 6 shapes that count are not like all 9 in age" in page
    rows = read_rows(tmp_path / "some" / "statistics" / "left_out.csv")
    (row,) = (row for row in rows if row["column"] == "age")
    assert (row["counted"], row["left_out"], row["least_left_out"]) == ("6", "3", "0.0")
    said = run_command(
        *(
            "variation",
            result,
            "--to",
            tmp_path / "less",
            "--exclude",
            *NAMES[:3],
            "tooth-4",
            "--jobs",
            1,
        ),
        *("--permutations", 99),
    )
    assert "exclude: 'tooth-4' is taken as 'Tooth_004'" in said.err
    assert "not like all 10 in age" in said.err
