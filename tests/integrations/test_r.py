"""The R package reads what a run writes, and refuses what is none of it. Skips without Rscript and jsonlite."""

import csv
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from collalign.analysis.procrustes import centroid_sizes
from tests.commands import read_json
from tests.optional import optional_program

PACKAGE = Path(__file__).resolve().parents[2] / "integrations" / "r"


def run_r(code):
    sources = "".join(
        f"source({json.dumps(str(file))}); " for file in sorted((PACKAGE / "R").glob("*.R"))
    )
    return subprocess.run(
        ["Rscript", "--vanilla", "-e", sources + code],
        capture_output=True,
        text=True,
        timeout=1200,
        check=False,
    )


INSTALL = "apt-get install r-base-core r-cran-jsonlite"
optional_program("Rscript", install=INSTALL)
pytestmark = pytest.mark.skipif(
    run_r("library(jsonlite)").returncode != 0,
    reason=f"R has no package jsonlite; install it with: {INSTALL}",
)


def transform(i):
    """A scale of i + 1 with a reflection of the second shape."""
    found = np.eye(4)
    found[:3] = (i + 1) * np.array([[1, 0, 0, 3], [0, 0, -1, 4], [0, 1 - 2 * (i == 1), 0, 5]])
    return found


@pytest.fixture
def out(tmp_path):
    rng = np.random.default_rng(0)
    labels = np.stack([rng.permutation(5) for _ in range(3)])
    positions = rng.standard_normal((3, 5, 3))
    names = np.array(["a", "zahn-ä", "c"])
    np.savez_compressed(
        tmp_path / "correspondences.npz",
        names=names,
        labels=labels,
        positions=positions,
        consensus=positions[0],
    )
    shapes = [
        {
            "name": str(name),
            "file": f"{name}.ply",
            "transform": transform(i).tolist(),
            "reflected": i == 1,
            "confidence": [0.99, 0.5, None][i],
        }
        for i, name in enumerate(names)
    ]
    record = {
        "shapes": shapes,
        "groups": [["a", "zahn-ä"], ["c"]],
        "notes": [{"code": "doubtful", "text": "Look at c."}],
        "excluded": [],
    }
    (tmp_path / "alignment.json").write_text(json.dumps(record), encoding="utf-8")
    return tmp_path


def test_coordinates_are_in_the_order_of_the_labels(out):
    done = run_r(
        f'x <- read_collalign("{out}"); stopifnot(dim(x$coords) == c(5, 3, 3)); '
        f'write.csv(data.frame(as.vector(x$coords)), "{out}/coords.csv", row.names = FALSE); '
        f'write.csv(data.frame(as.vector(x$transforms)), "{out}/transforms.csv", row.names = FALSE); '
        f'write.csv(data.frame(x$shapes$centroid_size), "{out}/sizes.csv", row.names = FALSE)'
    )
    assert done.returncode == 0, done.stderr
    with np.load(out / "correspondences.npz") as archive:
        rows = [
            p[np.argsort(order)]
            for p, order in zip(archive["positions"], archive["labels"], strict=True)
        ]
    expected = np.stack(
        [row / (i + 1) for i, row in enumerate(rows)], axis=2
    )  # sizes are those of the files
    assert np.allclose(column(out / "coords.csv"), expected.ravel(order="F"))
    assert np.allclose(column(out / "sizes.csv"), centroid_sizes(expected.transpose(2, 0, 1)))
    matrices = np.stack([transform(i) for i in range(3)], axis=2)
    assert np.allclose(column(out / "transforms.csv"), matrices.ravel(order="F"))


def test_points_that_incomplete_shapes_lack_are_missing(out):
    with np.load(out / "correspondences.npz") as archive:
        arrays = dict(archive)
    arrays["labels"][1, [0, 3]] = -1
    np.savez_compressed(out / "correspondences.npz", **arrays)
    record = read_json(out / "alignment.json")
    (out / "alignment.json").write_text(
        json.dumps(record | {"incomplete": [{"name": "zahn-ä"}]}), encoding="utf-8"
    )
    done = run_r(
        f'x <- read_collalign("{out}"); stopifnot(identical(x$shapes$incomplete, c(FALSE, TRUE, FALSE))); '
        f'write.csv(data.frame(as.vector(x$coords)), "{out}/coords.csv", row.names = FALSE, na = "nan")'
    )
    assert done.returncode == 0, done.stderr
    expected = np.full((5, 3, 3), np.nan)
    for at, (order, points) in enumerate(zip(arrays["labels"], arrays["positions"], strict=True)):
        expected[order[order >= 0], :, at] = points[order >= 0] / (at + 1)
    np.testing.assert_allclose(column(out / "coords.csv"), expected.ravel(order="F"))


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2", ">i8", "<u1", "|b1", "<U4"])
def test_arrays_of_every_kind_survive(tmp_path, dtype):
    values = np.arange(12).reshape(2, 3, 2) % 2
    np.savez(tmp_path / "x.npz", c=values.astype(dtype), f=np.asfortranarray(values.astype(dtype)))
    done = run_r(
        f'x <- read_npz("{tmp_path}/x.npz"); stopifnot(dim(x$c) == c(2, 3, 2), identical(x$c, x$f)); '
        f'cat(as.vector(x$c), sep = ",")'
    )
    assert done.returncode == 0, done.stderr
    words = {"TRUE": 1, "FALSE": 0, "True": 1, "False": 0}
    assert [words.get(w, w) for w in done.stdout.split(",")] == [
        v if dtype == "|b1" else str(v) for v in values.ravel(order="F").tolist()
    ]


def test_what_is_no_result_is_refused(out, tmp_path):
    assert "no alignment.json" in run_r(f'read_collalign("{tmp_path}/nothing")').stderr
    (out / "correspondences.npz").write_bytes(b"not a zip")
    assert "not a NumPy archive" in run_r(f'read_collalign("{out}")').stderr


def column(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return [float(row[0]) for row in list(csv.reader(stream))[1:]]
