"""Shapes in the coordinates of a map: exports are exact, and coarse steps and colours that are lost are named."""

import re

import numpy as np
import pytest

from collalign.tools.export.run import export
from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.shapes import read_shape
from data_tools.options import AS_STORED
from data_tools.rotations import random_rotation
from tests.commands import read_rows, run_command

FLAGS = ["--sampling.num-points", "12", "--sampling.num-dense-points", "50", "--jobs", "1"]
PLACE = np.array([456789.123, 5412345.678, 312.4])


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    """A folder of four objects of about two metres on a map, as text with tenths of a millimetre, and its result."""
    folder = tmp_path_factory.mktemp("survey")
    (folder / "in").mkdir()
    rng = np.random.default_rng(0)
    for at in range(4):
        shape = blob(np.random.default_rng(7), num_vertices=150)
        points = shape.vertices @ random_rotation(rng).T + PLACE + rng.normal(size=3) * 20
        points += 0.01 * rng.normal(size=points.shape)
        lines = ["v " + " ".join(f"{value:.4f}" for value in point) for point in points]
        lines += ["f " + " ".join(map(str, face + 1)) for face in shape.faces]
        (folder / "in" / f"s{at}.obj").write_text(
            "vt 0 0\nusemtl stone\n" + "\n".join(lines) + "\n"
        )
    run_command("align", folder / "in", "--out", folder / "out", *FLAGS)
    return folder


def near(points, file, atol=1e-6):
    """Whether every point is a vertex of a file."""
    own = read_shape(file, AS_STORED).vertices
    apart = np.abs(points[:, None] - own).max(axis=2).min(axis=1)
    return (apart < atol).all()


def test_landmarks_in_raw_space_are_points_of_the_files(surveyed, tmp_path):
    export(surveyed / "out", "csv", tmp_path, space="raw")
    rows = read_rows(tmp_path / "landmarks.csv")
    for name in ("s0", "s3"):
        points = np.array(
            [[float(row[axis]) for axis in "xyz"] for row in rows if row["name"] == name]
        )
        assert len(points) == 12
        assert near(points, surveyed / "in" / f"{name}.obj")
    for format, ending in (("slicer-json", "json"), ("tps", "tps"), ("morphologika", "txt")):
        paths = export(surveyed / "out", format, tmp_path / format, space="raw")
        text = "".join(path.read_text() for path in paths if path.suffix == f".{ending}")
        numbers = np.array(re.findall(r"-?\d+\.\d+", text), dtype=float)
        assert all(np.abs(numbers - value).min() < 1e-6 for value in points[0])


def test_coarse_steps_are_named_by_a_check_and_a_run(surveyed, tmp_path):
    (tmp_path / "in").mkdir()
    for file in sorted((surveyed / "in").iterdir()):
        shape = read_shape(file)
        single = shape.vertices.astype(np.float32)
        np.savez(tmp_path / "in" / f"{file.stem}.npz", vertices=single, faces=shape.faces)
    for more in (["--check"], []):
        said = run_command("align", tmp_path / "in", "--out", tmp_path / "out", *FLAGS, *more).out
        assert "Coordinates come in coarse steps" in said
        assert "s0 (0.5)" in said
        assert "Matched on a repaired copy" not in said or "coordinates come in steps" not in said
