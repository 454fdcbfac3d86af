"""Left and right of individuals are compared from their files, as a user does it."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import load
from collalign.statistics import write_surface_variation
from data_tools.datasets.synthetic import deformed_family, mirrored
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import InputError
from data_tools.io.shapes import write_ply
from data_tools.rotations import random_rotation
from tests.commands import read_json, read_rows, run_command

NUM = 5
#: How often each individual was measured on each side; one has no right side.
REPEATS = {"L": (2, 1, 1, 2, 1), "R": (1, 1, 2, 1, 0)}
#: The individual whose sides differ, and where its left one has a bump.
UNLIKE = 2


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Left and right blobs of five individuals, alike in all but one, aligned by the command line."""
    rng, place = np.random.default_rng(5), tmp_path_factory.mktemp("sides")
    base = blob(rng, num_vertices=300)
    base = replace(base, vertices=base.vertices * [1.6, 1.0, 0.75])
    (place / "shapes").mkdir()
    rows, marks = ["name,bone,way"], {}
    for at, shape in enumerate(deformed_family(base, NUM, rng, rms=0.03)):
        for side, counts in REPEATS.items():
            for again in range(counts[at]):
                points = shape.vertices
                if at == UNLIKE and side == "L":
                    gaps = ((points - points[points[:, 0].argmax()]) ** 2).sum(axis=1)
                    points = points + 0.15 * np.exp(-gaps / 0.2)[:, None] * [1.0, 0, 0]
                own = mirrored(replace(shape, vertices=points)) if side == "L" else shape
                noise = 0.001 * rng.standard_normal(points.shape)
                turned = rng.uniform(0.8, 1.2) * (own.vertices + noise) @ random_rotation(rng).T
                name = f"b{at}{side}{again}"
                write_ply(place / "shapes" / f"{name}.ply", turned, own.faces)
                marks[name] = turned[::30]
                rows.append(f"{name},{at},{side}")
    (place / "labels.csv").write_text("\n".join(rows) + "\n")
    np.savez(place / "landmarks.npz", **marks)
    run_command(
        *("align", place / "shapes", "--out", place / "out", "--labels", place / "labels.csv"),
        *("--group", "O", "--sampling.num-points", 48, "--jobs", 1),
    )
    return place / "out"


def test_sides_and_repeats_are_compared_and_said(result, tmp_path):
    words = ("variation", result, "--to", tmp_path / "out", "--jobs", 1, "--include-doubtful")
    said = run_command(*words, "--individual", "bone", "--side", "way", "--permutations", 99)
    assert "4 individuals have both sides, L and R." in said.err
    assert "One side is lacking of 4." in said.err
    assert "The repeatability of shape is" in said.err
    folder = tmp_path / "out" / "statistics"
    anova = {row["effect"]: row for row in read_rows(folder / "sides.csv")}
    assert [*anova] == ["individual", "side", "individual:side", "residual", "total"]
    assert [row["Df"] for row in anova.values()] == ["3", "1", "3", "3", "10"]
    asymmetry = {
        row["individual"]: float(row["asymmetry"]) for row in read_rows(folder / "asymmetry.csv")
    }
    others = [one for who, one in asymmetry.items() if who != str(UNLIKE)]
    assert asymmetry.keys() == {"0", "1", "2", "3"}
    assert asymmetry[str(UNLIKE)] > 2 * max(others)
    error = {row["effect"]: row for row in read_rows(folder / "measurement_error.csv")}
    assert float(error["individual"]["repeatability"]) > 0.9
    repeats = {row["individual"]: row["measurements"] for row in read_rows(folder / "repeats.csv")}
    assert repeats["2 R"] == "2"
    assert len(repeats) == 9
    assert "4 individuals have both sides" in (tmp_path / "out" / "variation.html").read_text(
        "utf-8"
    )
    tested = {row["model"] for row in read_rows(folder / "anova.csv")}
    assert not any("bone" in model for model in tested), "individuals are no covariate"
    options = read_json(tmp_path / "out" / "run-variation.json")["options"]
    assert options["sides"].count("L") == 7
    assert "bone" not in options["labels"]
    cited = run_command("status", tmp_path / "out", "--cite").out
    assert cited.startswith("We aligned")
    assert "Left and right of each individual were compared" in cited
    assert "By our choice, poses of a confidence below 95 % counted as well." in cited
    assert "99 random permutations" in cited


def test_what_cannot_be_compared_is_refused_before_anything_is_registered(result, tmp_path):
    words = ("variation", result, "--to", tmp_path / "out")
    for more, message in (
        (("--side", "way"), "name their column"),
        (("--individuals", "bone", "--side", "way", "--symmetry", "auto"), "not both"),
        (("--individuals", "bone", "--side", "bone"), "expected two sides, got 0, 1, 2, 3;"),
        (("--individuals", "way", "--side", "sex"), "sex"),
    ):
        assert message in run_command(*words, *more, ends=2).err
    with pytest.raises(InputError, match="measured twice"):
        write_surface_variation(result, tmp_path / "out", individuals=[*load(result).names])
    assert not (tmp_path / "out").exists()
