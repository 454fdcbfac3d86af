"""Shapes and expected values of statistics, which base R has computed from their definitions."""

import csv
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parent / "integrations" / "statistics"
SCRIPT, LANDMARKS, EXPECTED = (
    FOLDER / name for name in ("expected.R", "landmarks.csv", "expected.csv")
)


def landmark_shapes():
    """Return shapes (32, 9, 3), their individuals and their sides; left ones are not mirrored yet."""
    with LANDMARKS.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    points = np.array([[float(row[axis]) for axis in "xyz"] for row in rows]).reshape(-1, 9, 3)
    return points, [row["individual"] for row in rows[::9]], [row["side"] for row in rows[::9]]


def expected_values(path=EXPECTED):
    """Return the values by their names."""
    with path.open(newline="", encoding="utf-8") as stream:
        return {row["what"]: float(row["value"]) for row in csv.DictReader(stream)}


def check_expected(found):
    """Compare values with those of R, to 1e-8 of each."""
    expected = expected_values()
    for name, value in found.items():
        np.testing.assert_allclose(value, expected[name], rtol=1e-8, err_msg=name)
