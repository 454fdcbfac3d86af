"""The collections and the classification: their parts, and each from end to end on generated layouts."""

import numpy as np
import pytest

from collalign.engine.records import decode, encode
from collalign.engine.store import Store
from collalign.tools.variation.classification import refined_distance
from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import chair, crown
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments import load_experiment
from experiments.collections import aligning, classification, tooth_distances
from experiments.experiment import Bench, Cell
from experiments.write import write_experiment
from pairwise.dense import DensePoints

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


def cell(data, **settings):
    return Cell(data=data, settings=settings)


@pytest.mark.parametrize("name", ["classification", "figure13"])
def test_quick_run_writes_tables_and_pictures(name, layouts, tmp_path):
    experiment = load_experiment(name)
    with Store.memory() as store:
        bench = Bench(data=layouts, store=store, quick=True, quiet=True)
        outcome = experiment.measure(bench)
        written = write_experiment(experiment, outcome, bench, tmp_path)
    assert {path.suffix for path in written} == {".csv", ".png", ".md"}
    assert all(table.rows for table in outcome.tables)


def test_alignment_record_knows_the_errors_before_and_after(layouts):
    sizes = {"shapes": 4, "subsets": 1, "subset_size": 4, "points": 20, "seed": 2}
    settings = {
        "collection": "glasses",
        "way": "toolkit",
        "embedding": "xyz+invariants",
        "pairs": "all",
    } | sizes
    record = aligning.measure_alignment(cell(layouts, **settings))
    assert record["matched"] == 6 == len(record["own_deg"]) == len(record["pair_deg"])
    assert record["group"] == "SO"
    assert record["mirrored"] == record["unnoticed"] == 0
    assert record["within_20"] == 4
    assert (
        np.nan_to_num(record["candidate_deg"], nan=180) <= np.nan_to_num(record["own_deg"], nan=180)
    ).all()
    assert record["subsets"] == [1.0]
    assert decode(encode(record), "record")["matched"] == 6


def test_published_rotations_are_compared_with_the_landmarks(layouts, tmp_path):
    write_teeth(tmp_path / "teeth_pnas116")
    file = tmp_path / "teeth_pnas116" / aligning.PUBLISHED_FILE
    dataset = aligning.read_dataset("teeth", tmp_path)
    common = np.stack([dataset.rotation(0, i, group="O") for i in range(8)])
    common[7] = np.nan
    np.savez(file, names=dataset.names, R=common)
    record = aligning.measure_published_rotations(cell(tmp_path))
    assert record["shapes"] == 7
    assert record["within_20"] == 7
    assert record["worst_deg"] < 5
    common[4] *= -1.0
    np.savez(file, names=dataset.names, R=common)
    assert aligning.measure_published_rotations(cell(tmp_path))["mirrored"] == 6
    np.savez(file, names=dataset.names[:5], R=common[:5])
    with pytest.raises(InputError, match="no entry"):
        aligning.measure_published_rotations(cell(tmp_path))


def test_distances_vanish_for_the_same_surface_only(rng):
    points = rng.standard_normal((60, 3))
    points = (points - points.mean(axis=0)) / np.linalg.norm(points - points.mean(axis=0))
    turn = random_rotation(rng)
    one, same = (
        DensePoints.from_user(points),
        DensePoints.from_user(points[rng.permutation(60)] @ turn),
    )
    assert tooth_distances.one_to_one_distance(one.points, same.points @ turn.T) == pytest.approx(
        0, abs=1e-6
    )
    assert refined_distance(one, same, turn)[0] == pytest.approx(0, abs=1e-9)
    bent = points * [1.4, 1.0, 0.8]
    other = DensePoints.from_user(
        (bent - bent.mean(axis=0)) / np.linalg.norm(bent - bent.mean(axis=0))
    )
    one_to_one = tooth_distances.one_to_one_distance(one.points, other.points)
    assert one_to_one == pytest.approx(
        tooth_distances.one_to_one_distance(other.points, one.points)
    )
    there, back = (refined_distance(*pair, np.eye(3))[0] for pair in ((one, other), (other, one)))
    assert there == pytest.approx(back, rel=0.02)
    assert min(one_to_one, there) > 0.05


def test_teeth_are_classified_from_their_meshes(layouts):
    poses = tooth_distances.measure_poses(cell(layouts))
    assert poses["mirrored"] == poses["gross"] == 0
    assert (np.sign(np.linalg.det(poses["rotations"])) * SIDES == SIDES[0]).all()
    common = {"rows": [0, 8], "points": 40}
    fixed = tooth_distances.measure_at_poses(
        cell(layouts, poses=poses["rotations"].tolist(), near=3)
    )
    assert np.isnan(fixed["posed"]).any()
    assert np.isfinite(np.sort(fixed["posed"], axis=1)[:, :3]).all()
    alone = tooth_distances.measure_pairs(cell(layouts, **common, signs=SIDES.tolist(), coarse=24))
    assert np.nanmedian(alone["error_deg"]) < 5
    marks = tooth_distances.measure_landmarks(cell(layouts, landmarks=18))
    labels = {
        level: classification.counted_labels(marks["labels"][level])
        for level in classification.LEVELS
    }
    matrices = [
        marks["distances"],
        fixed["closest"],
        fixed["posed"],
        classification.matrix_of({"": alone}, "closest"),
    ]
    for matrix in matrices:
        results = classification.classify_all(matrix, labels, marks["names"])
        assert results["genus"].accuracy == 1.0
        assert results["genus"].num_scored == 8
    order = [0, 4, 1, 5, 2, 6, 3, 7]
    mixed = matrices[1][np.ix_(order, order)]
    assert classification.classify_all(mixed, labels, marks["names"])["genus"].accuracy < 0.5
