"""Landmarks, decisions and options find shapes by names that nearly agree, from the command line and in Python."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from collalign import load
from collalign.landmarks import transfer_landmarks
from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.shapes import write_ply
from data_tools.rotations import random_rotation
from tests.commands import run_command

NAMES = tuple(f"AMNH {100 + at}/skull" for at in range(4))
CHOSEN = [0, 50, 100, 150]
FLAGS = ("--sampling.num-points", 32, "--group", "SO", "--jobs", 1)
BY_HAND = "placed by an expert"


@pytest.fixture(scope="module")
def aligned(tmp_path_factory):
    """A folder for each specimen, with skull.ply; the result; and the landmarks of every one."""
    rng, place = np.random.default_rng(3), tmp_path_factory.mktemp("names")
    base = blob(rng, num_vertices=200)
    base = replace(base, vertices=base.vertices * [1.6, 1.0, 0.75])
    marks = {}
    for name, shape in zip(NAMES, deformed_family(base, len(NAMES), rng, rms=0.02), strict=True):
        file = place / "shapes" / f"{name}.ply"
        file.parent.mkdir(parents=True)
        points = shape.vertices @ random_rotation(rng).T
        write_ply(file, points, shape.faces)
        marks[name] = points[CHOSEN]
    run_command(
        "align", place / "shapes", "--recursive", "--out", place / "out", "--no-report", *FLAGS
    )
    assert load(place / "out").names == NAMES
    return place, marks


def templates_of(folder):
    """Return the templates that a transfer recorded, by the status in its table."""
    with (folder / "transfer.csv").open(newline="") as stream:
        return {row["name"] for row in csv.DictReader(stream) if row["status"] == BY_HAND}


def test_landmarks_belong_to_the_mesh_next_to_them(aligned):
    place, marks = aligned
    files = []
    for name in NAMES[:2]:
        points = [{"label": f"F-{at}", "position": p.tolist()} for at, p in enumerate(marks[name])]
        files.append(place / "shapes" / f"{name}.mrk.json")
        files[-1].write_text(
            json.dumps({"markups": [{"type": "Fiducial", "controlPoints": points}]})
        )
    run_command(
        "transfer", place / "out", "--landmarks", *files, "--to", place / "marks", "--jobs", 1
    )
    assert templates_of(place / "marks") == {*NAMES[:2]}


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("IMAGE=x\\amnh-0102.jpg\nID=0", "called by IMAGE"),
        ("IMAGE=view.jpg\nID=C:\\data\\AMNH_102\\skull.ply", ""),
    ],
)
def test_tps_names_specimens_by_image_folder_or_path(aligned, tmp_path, lines, said):
    place, marks = aligned
    points = "\n".join(" ".join(map(str, point)) for point in marks[NAMES[2]].tolist())
    (tmp_path / "a.tps").write_text(f"LM3={len(CHOSEN)}\n{points}\n{lines}\n")
    words = ("transfer", place / "out", "--landmarks", tmp_path / "a.tps", "--to", tmp_path / "to")
    told = run_command(*words, "--jobs", 1)
    assert said in told.err
    assert "'AMNH 102/skull'" in told.err
    assert templates_of(tmp_path / "to") == {NAMES[2]}
    found = transfer_landmarks(place / "out", [tmp_path / "a.tps"], progress=False)
    assert found.status[2] == (BY_HAND,) * len(CHOSEN)
    assert BY_HAND not in found.status[0]
