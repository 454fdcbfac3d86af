"""Each figure of the paper from end to end, on generated collections."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.datasets.synthetic import bent
from data_tools.datasets.synthetic_shapes import figure
from data_tools.io.shapes import write_mesh
from experiments import load_experiment
from experiments.figures import figure3, figure5, figure14
from experiments.maps import map_sets
from experiments.write import write_experiment

pytestmark = pytest.mark.usefixtures("quick_search")


@pytest.fixture(scope="module")
def bodies():
    base, rng = figure(resolution=2), np.random.default_rng(7)
    return [base, bent(base, rng, angle=0.4), bent(base, rng, angle=0.4)]


@pytest.fixture(scope="module")
def collections(tmp_path_factory, bodies):
    """All sets of maps in their publishers' layouts, made of three poses of one figure."""
    root = tmp_path_factory.mktemp("collections")
    write_scape(root / "scape71", bodies)
    for i, body in enumerate(bodies):
        write_mesh(root / "tosca_centaur6" / "meshes" / f"centaur{i}.off", body)
    lines = ["set,method,source,target,average_geodesic_error,fraction_guessed"]
    for number, name in enumerate((*map_sets.SHREC07_CLASSES, *map_sets.SAME_PLACES)):
        names = [str(10 * number + i) for i in range(3)]
        marks = np.arange(0, 1200, 30)
        if name == "armadillo":
            marks[list(map_sets.SAME_PLACES[name])] = marks[list(map_sets.SAME_PLACES["human"])]
        write_shrec_class(root / "shrec07_dev" / name, dict(zip(names, bodies, strict=True)), marks)
        lines.append(f"SHREC,BlendedMap,{names[0]},{names[1]},0.9,0.5")
    (root / "shrec07_dev" / "bim2011_published_errors.csv").write_text("\n".join(lines))
    return root


def write_scape(folder, bodies):
    folder.mkdir()
    names = [f"mesh{i:03d}" for i in range(len(bodies))]
    vertices, faces = (
        np.stack([getattr(body, key) for body in bodies]) for key in ("vertices", "faces")
    )
    np.savez(folder / "all.npz", vertices=vertices, faces=faces, names=names)
    (folder / "Corr_Scape.query").write_text(
        "SCAPE\n1\n0\nSCAPE\n1\n2\nSCAPE\n1\n1\nSCAPE\n1\n71\n"
    )
    (folder / "bim2011_published_errors.csv").write_text(
        "set,method,source,target,average_geodesic_error,fraction_guessed\n"
        "SCAPE,BlendedMap,mesh000,mesh002,0.08,1\nSCAPE,BlendedMap,mesh001,mesh071,0.7,1\n"
        "SCAPE,Other,mesh001,mesh000,0.09,1\n"
    )


def write_shrec_class(folder, shapes, marks):
    (folder / "landmarks").mkdir(parents=True)
    for name, shape in shapes.items():
        write_mesh(folder / "meshes" / f"{name}.off", shape)
        rows = [
            f"{v} {x} {y} {z}" for v, (x, y, z) in zip(marks, shape.vertices[marks], strict=True)
        ]
        (folder / "landmarks" / f"{name}.vts").write_text("\n".join(rows))


@pytest.fixture
def bench(bench, collections):
    return replace(bench, data=collections)


def rows_of(bench, name, folder):
    """Run an experiment from end to end, files included, and return the rows of its last table."""
    experiment = load_experiment(name)
    outcome = experiment.measure(bench)
    assert all(file.stat().st_size for file in write_experiment(experiment, outcome, bench, folder))
    return [dict(row) for row in outcome.tables[-1].rows]


def test_figure5(bench, tmp_path):
    outcome = load_experiment("figure5").measure(bench)
    histograms, runs = (table.rows for table in outcome.tables)
    assert len(histograms) == 2 * len(figure5.SIGMAS[::2])
    assert all(row["bound"] <= row["least"] + 1e-6 for row in histograms)
    exact = [row for row in histograms if row["sigma"] == 0]
    assert max(max(row["least"], row["pm_sdp"]) for row in exact) < 1e-9
    assert [row["dim"] for row in runs] == [3, 3, 5, 5]
    reused = bench.num_reused
    rows_of(bench, "figure5", tmp_path)
    assert bench.num_reused > reused


def test_figure14(bench, tmp_path):
    rows = rows_of(bench, "figure14", tmp_path)
    assert [row["panel"] for row in rows] == ["a", "b", "c"]
    assert all(row["difference"] < 2 * figure14.TOL for row in rows if row["panel"] == "c")


def test_figure3(bench, tmp_path):
    rows = rows_of(bench, "figure3", tmp_path)
    assert len(rows) == 2 * len(figure3.NUM_PAIRS)
    assert all(row["at_100"] == 100.0 and row["at_30"] > 60.0 for row in rows)


def test_maps_of_registered_bodies_and_of_a_class(bench, tmp_path):
    rows = {(row["set"], row["method"]): row for row in rows_of(bench, "maps", tmp_path)}
    for name in ("scape", "ant"):
        ours = rows[name, "collalign"]
        assert ours["direct"] < 0.05
        assert ours["pairs"] == rows[name, "the paper's fast chain"]["pairs"] == 1
        assert rows[name, "the paper's fast chain"]["ours"] == ours["direct"]
    assert [row["direct"] for (name, _), row in rows.items() if row["origin"] == "published"] == [
        0.08,
        0.9,
    ]
