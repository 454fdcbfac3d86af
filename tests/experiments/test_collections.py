"""The collections and the classification, from end to end on generated layouts."""

from dataclasses import replace

import numpy as np
import pytest

from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import chair, crown
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments import load_experiment
from experiments.write import write_experiment

MARKS = np.arange(0, 18 * 30, 30)
SIDES = np.array([1, -1, 1, 1, -1, -1, 1, -1])


def posed(shape, rng, side=1):
    return np.asarray(shape.vertices * [side, 1, 1] @ random_rotation(rng).T)


def chiral_crown(rng):
    """A crown that is longer than wide and twisted, so that its mirror image is another shape."""
    shape = crown(num_vertices=560)
    x, y, z = (shape.vertices * [1.5, 1.0, 1.0]).T
    angle = 0.6 * z
    twisted = np.column_stack(
        [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z]
    )
    return deformed_family(Shape.from_arrays(twisted, shape.faces, name="T"), 1, rng, rms=0.03)[0]


def write_teeth(folder):
    """Two genera of four crowns each, in random poses, some mirrored, in the layout of the teeth."""
    rng = np.random.default_rng(3)
    members = [
        shape for _ in range(2) for shape in deformed_family(chiral_crown(rng), 4, rng, rms=0.003)
    ]
    lines = ["name,file,order,family,genus,chirality_from_landmarks"]
    marks = []
    for i, (shape, side) in enumerate(zip(members, SIDES.tolist(), strict=True)):
        vertices = posed(shape, rng, side)
        faces = shape.faces[:, ::-1] if side < 0 else shape.faces
        write_mesh(folder / "meshes" / f"T{i}_sas.off", Shape.from_arrays(vertices, faces))
        marks.append(vertices[MARKS])
        lines.append(f"T{i},T{i}_sas.off,Order,Family{i // 4},Genus{i // 4},{side}")
    (folder / "labels.csv").write_text("\n".join(lines), "utf-8")
    names = [f"T{i}" for i in range(8)]
    np.savez(
        folder / "landmarks_mesh_coords.npz",
        names=names,
        landmarks=marks,
        nearest_vertex=np.tile(MARKS, (8, 1)),
    )


def write_class(folder):
    rng = np.random.default_rng(4)
    for number, shape in enumerate(deformed_family(chair(resolution=1), 4, rng, rms=0.01)):
        vertices = posed(shape, rng)
        write_mesh(folder / "meshes" / f"{number}.off", Shape.from_arrays(vertices, shape.faces))
        rows = [f"{i} " + " ".join(map(str, vertices[i])) for i in range(0, 200, 20)]
        (folder / "landmarks").mkdir(exist_ok=True)
        (folder / "landmarks" / f"{number}.vts").write_text("\n".join(rows), "utf-8")


@pytest.fixture(scope="module")
def layouts(tmp_path_factory):
    root = tmp_path_factory.mktemp("collections")
    write_teeth(root / "teeth_pnas116")
    write_class(root / "shrec07_dev" / "glasses")
    return root


@pytest.mark.parametrize("name", ["classification", "figure13"])
def test_quick_run_writes_tables_and_pictures(name, layouts, bench, tmp_path):
    experiment = load_experiment(name)
    bench = replace(bench, data=layouts)
    outcome = experiment.measure(bench)
    written = write_experiment(experiment, outcome, bench, tmp_path)
    assert {path.suffix for path in written} == {".csv", ".png", ".md"}
    assert all(table.rows for table in outcome.tables)
