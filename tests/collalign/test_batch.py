"""Batch files: read with care, estimated without being run, run one after the other."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from collalign import load
from collalign.batch import estimate_job, read_batch, run_batch
from collalign.engine.run_options import RunOptions
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import InputError, OptionsError
from tests.commands import run_command
from tests.finished_runs import chairs


@pytest.fixture
def folder(tmp_path):
    write_collection(tmp_path / "chairs", chairs(3))
    return tmp_path


def batch_file(folder, text):
    path = folder / "batch.toml"
    path.write_text(text)
    return path


GOOD = """
[options]
seed = 3
[options.sampling]
num_points = 20
num_dense_points = 50
[[jobs]]
folder = "chairs"
out = "a"
[[jobs]]
folder = "chairs"
out = "b"
[jobs.options]
group = "O"
[jobs.options.sampling]
num_points = 16
"""


def test_jobs_share_options_and_override_them(folder):
    first, second = read_batch(batch_file(folder, GOOD))
    assert (first.options.seed, first.options.sampling.num_points, first.options.group) == (
        3,
        20,
        "auto",
    )
    assert (second.options.seed, second.options.sampling.num_points, second.options.group) == (
        3,
        16,
        "O",
    )
    assert second.options.sampling.num_dense_points == 50
    (several,) = read_batch(
        batch_file(folder, "[[jobs]]\nfolder = ['a', '@b.txt']\nout = 'c'\nrecursive = true\n")
    )
    assert several.folders == (folder / "a", Path(f"@{folder / 'b.txt'}"))
    assert (several.recursive, several.parts, several.include) == (True, False, ())
    assert (second.recursive, second.parts) == (False, False)
    (tables,) = read_batch(
        batch_file(
            folder,
            "[[jobs]]\nfolder = 'a'\nout = 'c'\ninclude = ['*.csv']\n"
            "[options.cleaning]\ncolumns = 'class,x,y,z'\n",
        )
    )
    assert tables.include == ("*.csv",)
    assert tables.options.cleaning.columns == "class,x,y,z"
    (whole,) = read_batch(batch_file(folder, "[[jobs]]\nfolder = 'a'\nout = 'c'\nparts = true\n"))
    for file in (folder / "chairs").glob("*.ply"):
        (folder / "a" / file.stem).mkdir(parents=True)
        shutil.copy(file, folder / "a" / file.stem / "seat.ply")
        np.savetxt(folder / "a" / file.stem / "nails.xyz", np.eye(3))
    assert estimate_job(whole, RunOptions(jobs=1)).num_shapes == 3
    assert first.folders == (folder / "chairs",)


@pytest.mark.parametrize(
    ("text", "error", "word"),
    [
        ("seed = 3", InputError, "unknown entry 'seed'"),
        ("[options]\nseed = 3", InputError, "nothing to do"),
        ("jobs = 3", InputError, "batch.toml --jobs 3"),
        ("jobs = 3\n[[jobs]]\nfolder = 'x'\nout = 'y'", InputError, "batch.toml --jobs 3"),
        (
            "[options]\njobs = 3\n[[jobs]]\nfolder = 'x'\nout = 'y'",
            InputError,
            "batch.toml --jobs 3",
        ),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\njobs = 3", InputError, "batch.toml --jobs 3"),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\nkinds_by = 'age'", OptionsError, "kinds_by: .*folder"),
        ("[[jobs]]\nfolder = 'x'", InputError, "job 1"),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\nparts = 1", OptionsError, "true or false"),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\ninclude = '*.csv'", InputError, "list of patterns"),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\nextra = 1", OptionsError, "job 1: .*extra"),
        (
            "[[jobs]]\nfolder = 'x'\nout = 'y'\n[[jobs]]\nfolder = 'z'\nout = 'y'",
            InputError,
            "same folder",
        ),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\n[jobs.options]\ngruop = 'O'", OptionsError, "gruop"),
        ("[option]\n[[jobs]]\nfolder = 'x'\nout = 'y'", InputError, "option"),
        ("options = 1\n[[jobs]]\nfolder = 'x'\nout = 'y'", OptionsError, "table"),
        ("[[jobs]]\nfolder = 'x'\nout = 'y'\noptions = 1", OptionsError, "job 1"),
        (
            "[[jobs]]\nfolder = 'x'\nout = 'y'\n[jobs.options]\nstrict = 'no'",
            OptionsError,
            "strict",
        ),
        (
            "[[jobs]]\nfolder = 'x'\nout = 'y'\n[jobs.options]\ncertify_budget_s = inf",
            OptionsError,
            "certify_budget_s",
        ),
        ("not toml", InputError, "TOML"),
        ("a = " + "[" * 5000 + "]" * 5000, InputError, "nested too deeply"),
        (
            "[options]\nsampling = 5\n[[jobs]]\nfolder = 'x'\nout = 'y'",
            OptionsError,
            "sampling: expected a table",
        ),
    ],
)
def test_bad_files_are_refused_by_name(text, error, word, tmp_path):
    path = batch_file(tmp_path, text)
    with pytest.raises(error, match=word) as raised:
        read_batch(path)
    assert "batch.toml" in str(raised.value)


def test_dry_run_estimates_and_writes_nothing(folder):
    path = batch_file(folder, GOOD)
    estimate = estimate_job(read_batch(path)[0], RunOptions(jobs=1))
    assert (estimate.num_shapes, estimate.num_pairs) == (3, 3)
    assert not math.isnan(estimate.seconds)
    assert list(estimate.stages_s) == ["shapes", "pairs", "poses", "confidence", "outputs", "start"]
    assert all(seconds > 0 for stage, seconds in estimate.stages_s.items() if stage != "start")
    assert estimate.stages_s["start"] >= 0  # one job starts no worker
    assert estimate.seconds == pytest.approx(sum(estimate.stages_s.values()))
    told = json.loads(run_command("batch", path, "--dry-run", "--jobs", "1", "--json").out)["jobs"][
        0
    ]
    assert (told["shapes"], told["pairs"]) == (3, 3)
    assert told["seconds"] == pytest.approx(sum(one["seconds"] for one in told["stages"].values()))
    assert {stage: one["tasks"] for stage, one in told["stages"].items()} == {
        "shapes": 3,
        "pairs": 10,
        "poses": None,
        "confidence": 3,
        "outputs": 3,
        "start": None,
    }
    assert 1_000 < told["store_bytes"] < 1_000_000
    assert not (folder / "a").exists()


def test_a_dry_run_counts_the_pairs_within_kinds_that_the_file_names(folder):
    for place in ("all/a", "all/b"):
        shutil.copytree(folder / "chairs", folder / place)
    text = "[[jobs]]\nfolder = 'all'\nout = 'c'\nrecursive = true\n"
    (together,) = read_batch(batch_file(folder, text + GOOD.partition("[[")[0]))
    (apart,) = read_batch(batch_file(folder, text + "kinds_by = 'folder'\n"))
    run = RunOptions(jobs=1)
    numbers = [
        estimate_job(replace(job, options=together.options), run).num_pairs
        for job in (together, apart)
    ]
    assert numbers == [15, 6]


def test_python_runs_a_batch_and_says_what_failed(folder):
    text = GOOD.replace('folder = "chairs"\nout = "a"', 'folder = "nowhere"\nout = "a"')
    lost, found = run_batch(batch_file(folder, text), run={"jobs": 1}, progress=False)
    assert lost.collection is None
    assert "nowhere" in lost.error
    assert found.collection is not None
    assert not found.error
    assert load(folder / "b").names == found.collection.names
    again = run_batch(read_batch(folder / "batch.toml")[1:], run={"jobs": 1}, progress=False)
    assert again[0].collection is not None
    assert again[0].collection.run.num_reused == 6
