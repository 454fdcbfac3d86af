"""The experiments of the matcher: their parts, and each from end to end on generated layouts."""

import numpy as np
import pytest

from collalign.engine.store.store import Store
from data_tools.datasets.synthetic_shapes import blob
from data_tools.embedding.embedding import sample_shape
from data_tools.io.shapes import write_mesh
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments import load_experiment
from experiments.datasets import read_range_scans
from experiments.experiment import Bench
from experiments.pairs import matching_energies, matching_table
from experiments.pairs.incomplete_sets import overlap_share
from experiments.pairs.posed_samples import TEETH_MIXED, TEETH_ONE_SIDE, posed_pairs
from experiments.write import write_experiment
from pairwise.matching import match_problem
from pairwise.options import MatchOptions
from tests.experiments.test_collections import write_class, write_teeth

SCANS = ("left", "middle", "right")


def write_scans(folder):
    """Three parts of one surface, each in its own frame, and their poses."""
    rng = np.random.default_rng(5)
    whole = blob(rng, num_vertices=1600)
    along = whole.vertices[:, 0]
    lines = []
    for name, (low, high) in zip(SCANS, ((0.0, 0.8), (0.1, 0.9), (0.2, 1.0)), strict=True):
        kept = (along >= np.quantile(along, low)) & (along <= np.quantile(along, high))
        turn = random_rotation(rng)
        write_mesh(folder / f"{name}.ply", Shape.from_arrays(whole.vertices[kept] @ turn))
        half = np.trace(turn) + 1.0
        w = 0.5 * np.sqrt(half)
        x, y, z = (np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])) / (4.0 * w)
        lines.append(f"bmesh {name}.ply 0 0 0 {-x} {-y} {-z} {w}")
    (folder / "scans.conf").write_text("\n".join(lines), "utf-8")


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    root = tmp_path_factory.mktemp("matching")
    write_teeth(root / "teeth_pnas116")
    write_class(root / "shrec07_dev" / "teddy")
    write_scans(root / "stanford_bunny_scans")
    return root


@pytest.mark.parametrize("name", ["matching_table", "matching_energies"])
def test_quick_run_writes_tables(name, layouts, tmp_path):
    experiment = load_experiment(name)
    with Store.memory() as store:
        bench = Bench(data=layouts, store=store, quick=True, quiet=True)
        outcome = experiment.measure(bench)
        write_experiment(experiment, outcome, bench, tmp_path)
    assert all(table.rows for table in outcome.tables)


@pytest.mark.parametrize(("name", "group_dets"), [(TEETH_ONE_SIDE, {1}), (TEETH_MIXED, {1, -1})])
def test_true_poses_fit_and_others_do_not(name, group_dets, layouts):
    pairs = list(
        posed_pairs(
            layouts,
            name,
            SamplingOptions(num_points=24, num_dense_points=80),
            EmbeddingOptions(kind="xyz"),
            num_shapes=4,
            num_pairs=6,
            seed=1,
        )
    )
    assert len(pairs) == 6
    assert {round(float(np.linalg.det(pair.truth))) for pair in pairs} <= group_dets
    for pair in pairs:
        assert pair.errors_deg(pair.truth[None]) == pytest.approx(0.0, abs=1e-5)
        assert pair.errors_deg(-pair.truth[None]) == 180.0
        assert pair.dense is not None
    errors = [float(p.errors_deg(match_problem(p.problem, MatchOptions()).R_target_source)) for p in pairs]
    assert np.median(errors) < 20.0


def test_shares_count_what_is_within_the_limit():
    record = {
        "best": np.array([5.0, 25.0, 180.0, 19.0]),
        "top": np.array([5.0, 15.0, 180.0, 19.0]),
        "dense": np.array([4.0, 3.0, 180.0, 18.0]),
        "dense_top": np.array([4.0, 3.0, 10.0, 18.0]),
        "bound": np.array([0.5, 0.7]),
        "seconds": 0.4,
        "refinement_s": 0.8,
    }
    row = matching_table.default_row("SHREC07, all", 20, [record, record])
    assert [row[key] for key in ("pairs", "best", "top", "dense", "dense_top")] == [8, 50.0, 75.0, 75.0, 100.0]
    assert row["ms"] == pytest.approx(100.0)
    assert row["dense_ms"] == pytest.approx(200.0)
    text = matching_table.findings([row])
    assert "best by samples right: 50.0 %, at least 88 % wanted: **missed**" in text
    good = matching_table.findings([row | {"best": 88.0}])
    assert "88.0 %, at least 88 % wanted: reached" in good
    settings = {"collection": "ant", "kind": "xyz", "metric": "geodesic", "points": 20}
    assert matching_table.table_row(settings, record)["bound"] == pytest.approx(0.6)


def test_energies_count_what_is_worse():
    record = {"matched": np.array([1.0, 2.0, 3.3, 4.0]), "searched": np.array([1.0, 2.5, 3.0, 4.0 - 1e-9])}
    record |= {"match_s": 1.0, "merged_s": 4.0, "timed_match_s": 0.5, "each_s": 50.0}
    row = matching_energies.energies_row("all", 20, [record])
    assert row["no_worse"] == 75.0
    assert row["better"] == 25.0
    assert row["excess"] == pytest.approx(0.1)
    assert row["share"] == pytest.approx(0.01)
    assert "**missed**" in matching_energies.findings([row])
    assert "reached" in matching_energies.findings([row | {"no_worse": 100.0, "pairs": 200}])
    assert "too few" in matching_energies.findings([row | {"no_worse": 100.0}])
    assert "**missed**" in matching_energies.findings([row | {"no_worse": 100.0, "share": 0.2}])


def test_scans_overlap_as_much_as_they_were_cut_to(layouts):
    scans = read_range_scans(layouts / "stanford_bunny_scans")
    sampling = SamplingOptions(num_points=40, metric="euclidean", normalisation="none", num_dense_points=300)
    samples = [sample_shape(scans.shape(i), sampling, EmbeddingOptions(kind="xyz")) for i in range(len(scans))]
    left, middle, right = (scans.names.index(name) for name in SCANS)
    assert overlap_share(scans, samples, left, middle) == pytest.approx(7 / 8, abs=0.06)
    assert overlap_share(scans, samples, left, right) == pytest.approx(6 / 8, abs=0.08)
