"""What a caller knows goes into a run where the pipeline has its own, and is judged like that."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

import collalign
from collalign import align_collection
from data_tools.datasets.synthetic import write_collection
from data_tools.errors import InputError, OptionsError
from data_tools.rotations import rotation_angle_deg
from tests.commands import read_json, run_command
from tests.finished_runs import chairs
from tests.notes import only

NUM = 4
OPTIONS = {"sampling": {"num_points": 24, "num_dense_points": 0}}
OPTIONS |= {"incomplete": "never", "maps": "never"}


@pytest.fixture(scope="module")
def planted():
    return chairs(NUM)


def align(planted, **keywords):
    shapes = {shape.name: shape for shape in planted.shapes}
    return align_collection(shapes, options=OPTIONS, progress=False, **{"jobs": 1} | keywords)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return tmp_path_factory.mktemp("own") / "store.sqlite"


@pytest.fixture(scope="module")
def plain(planted, store):
    return align(planted, store=store)


def names(planted, *positions):
    return tuple(planted.shapes[i].name for i in positions)


def test_matched_vertices_give_a_pose_of_the_pair(planted, store):
    few = {"matching": {"strategy": "search", "max_candidates": 1}}
    first, second = names(planted, 0, 1)
    right = planted.relative_rotation(0, 1)
    posed = planted.shapes[1].vertices @ right.T
    _, near = cKDTree(planted.shapes[0].vertices).query(posed)
    rows = np.column_stack([np.arange(len(posed)), near])[::7]
    found = align(planted, store=store, correspondences={(second, first): rows}, **few)
    assert found.own == ("correspondences",)
    assert only(found.notes, "given").values == {"num_posed": 1, "num_near": 1, "near_deg": 20.0}
    assert rotation_angle_deg(found.pairs[first, second].rotations, right).min() < 15
    one, other = ((shape.vertices, shape.faces) for shape in planted.shapes[:2])
    shifted = (
        np.vstack([np.zeros((1, 3)), one[0]]),
        one[1] + 1,
    )  # its first vertex is of no triangle
    later = {(second, first): np.add(rows, [0, 1])}
    found = collalign.align_collection(
        {first: shifted, second: other}, correspondences=later, jobs=1, progress=False, **few
    )
    assert rotation_angle_deg(found.pairs[first, second].rotations, right).min() < 15
    with pytest.raises(
        InputError, match=r"correspondences\[.*\]: expected three or more matches that do not lie"
    ):
        align(planted, store=store, correspondences={(second, first): rows[[0, 0, 0]]})
    with pytest.raises(InputError, match=r"of .*: indices run from .* to 99999"):
        align(planted, store=store, correspondences={(second, first): [[0, 99999], [1, 1], [2, 2]]})


def test_a_pair_of_no_weight_is_left_out_and_others_weigh_in_the_graph(planted, store):
    first, second, third = names(planted, 0, 1, 2)
    found = align(planted, store=store, pair_weights={(second, first): 0, (first, third): 0.25})
    assert (first, second) not in found.pairs
    assert found.pairs[first, third].weight == 0.25
    graph = collalign.pair_graph(found.pairs, len(found), found.group)
    assert sorted(graph.weights.tolist()) == [0.25] + [1.0] * (len(found.pairs) - 1)
    again = collalign.synchronization.synchronize_graph(graph).rotations
    for i in range(NUM):
        assert (
            rotation_angle_deg(again[0].T @ again[i], found.rotations[0].T @ found.rotations[i])
            < 10
        )


def test_stages_of_ones_own_give_the_result_of_the_pipeline(planted, plain):
    samples = dict(zip(plain.names, plain.samples, strict=True))
    again = align(planted, samples=samples, embedding={"kind": "xyz"})
    np.testing.assert_array_equal(again.samples, plain.samples)
    np.testing.assert_array_equal(again.made.coordinates, plain.made.coordinates)
    assert again.made.invariants.shape[2] == 0
    poses = dict(zip(plain.names, plain.rotations, strict=True))
    np.testing.assert_allclose(align(planted, fixed=poses).transforms, plain.transforms, atol=1e-9)


def heights(shape):
    """What a rotation does not change: how far each vertex is from the centroid."""
    return np.linalg.norm(shape.vertices - shape.vertices.mean(axis=0), axis=1)[:, None]


def test_invariants_take_the_place_of_descriptors_at_the_samples(planted, plain, store):
    found = align(planted, invariants=heights, invariants_weight=0.3, store=store)
    as_arrays = {shape.name: heights(shape) for shape in reversed(planted.shapes)}
    again = align(planted, invariants=as_arrays, invariants_weight=0.3, store=store)
    np.testing.assert_array_equal(found.made.invariants, again.made.invariants)
    assert (found.run.num_reused, again.run.num_reused) == (0, NUM + len(again.pairs))
    assert align(planted, invariants=heights, store=store).run.num_reused == 0  # of another weight
    assert align(planted, store=store).run.num_reused == NUM + len(plain.pairs)
    for shape, rows, at, where in zip(
        planted.shapes, found.made.invariants, found.samples, found.made.coordinates, strict=True
    ):
        np.testing.assert_allclose((rows**2).sum(), 0.3 * (where**2).sum())
        assert np.corrcoef(rows[:, 0], heights(shape)[at, 0])[0, 1] > 1 - 1e-9


def test_the_command_takes_a_file_and_results_say_what_they_cannot_repeat(
    planted, tmp_path, capsys
):
    write_collection(tmp_path / "shapes", planted)
    (tmp_path / "values").mkdir()
    for shape in planted.shapes:
        np.save(tmp_path / "values" / f"{shape.name}.npy", heights(shape))
    first, second, third = names(planted, 0, 1, 2)
    pairs = [
        {"target": first, "source": second, "weight": 0},
        {
            "target": first,
            "source": third,
            "rotations": [planted.relative_rotation(0, 2).tolist()],
            "weight": 2,
        },
        {"target": second, "source": third, "vertices": [[0, 0], [1, 1], [2, 2], [9, 9]]},
    ]
    own, out = tmp_path / "own.json", tmp_path / "out"
    own.write_text(json.dumps({"pairs": pairs, "invariants": "values"}))
    flags = [
        "--sampling.num-points",
        "24",
        "--sampling.num-dense-points",
        "0",
        "--jobs",
        "1",
        "--no-report",
    ]
    run_command("align", tmp_path / "shapes", "--out", out, "--own", own, *flags)
    said = "Given by you: invariants (1 columns of weight 0.4); poses of 2 pairs, "
    assert said in capsys.readouterr().out
    record = read_json(out / "alignment.json")
    assert record["decided"]["own"] == [
        "invariants",
        "candidates",
        "correspondences",
        "pair_weights",
    ]
    assert collalign.load(out).own == (
        "invariants",
        "candidates",
        "correspondences",
        "pair_weights",
    )
    run_command("stability", out, ends=2)
    assert (
        "aligned with invariants of the caller's own, which a result does not keep"
        in capsys.readouterr().err
    )
    own.write_text(json.dumps({"pairs": [{"source": first}]}))
    run_command("align", tmp_path / "shapes", "--out", out, "--own", own, ends=2)
    assert "own.json: no 'target' is given" in capsys.readouterr().err
    own.write_text(json.dumps({"candidates": []}))
    run_command("align", tmp_path / "shapes", "--out", out, "--own", own, ends=2)
    assert "there is no entry 'candidates'" in capsys.readouterr().err
    run_command("align", tmp_path / "shapes", "--out", tmp_path / "values", "--own", own, ends=2)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"candidates": {("a", "b"): np.eye(2)}}, r"candidates\[a, b\]: expected 3 x 3"),
        ({"candidates": {("a", "b"): np.eye(3) * 2}}, r"candidates\[a, b\]: not orthogonal"),
        ({"candidates": {"ab": np.eye(3)}}, "candidates: expected pairs of two names, got 'ab'"),
        ({"candidates": {("a", "x"): np.eye(3)}}, "candidates: no shape is called 'x'"),
        (
            {"candidates": {("a", "b"): -np.eye(3)}, "group": "SO"},
            r"candidates\[a, b\]: contains a reflection",
        ),
        (
            {"pair_weights": {("a", "b"): -1}},
            r"pair_weights\[a, b\]: expected a number of at least 0",
        ),
        (
            {"pair_weights": {("a", "b"): 1, ("b", "a"): 2}},
            "b and a are there twice|a and b are there twice",
        ),
        ({"samples": {"a": [0, 1, 2, 3]}}, "samples: every shape needs its own, 'b' has none"),
        (
            {"samples": {"a": [0, 1, 2, 2], "b": [0, 1, 2, 3]}},
            r"samples\[a\]: expected at least 4 different vertices",
        ),
        (
            {"samples": {"a": range(4), "b": range(5)}},
            "samples: a has 4 columns or vertices, b has 5",
        ),
        (
            {"samples": {"a": [0, 1, 2, 900], "b": range(4)}, "strict": True},
            "a: samples: vertex 900 is none of the",
        ),
        (
            {"invariants": {"a": np.ones((3, 2)), "b": np.ones((40, 2))}, "strict": True},
            "a: invariants: 3 rows for 40",
        ),
        (
            {"invariants": lambda shape: shape.vertices[:, 0]},
            r"invariants\[a\]: expected shape \(any, any\)",
        ),
        (
            {"candidates": {(0, 1): np.eye(3)}},
            r"candidates: expected pairs of two names, got \(0, 1\)",
        ),
        (
            {"correspondences": {("a", "b"): [[0, 0.5]]}},
            r"correspondences\[a, b\]: expected integer indices",
        ),
        (
            {"correspondences": {("a", "b"): [0, 1, 2]}},
            r"correspondences\[a, b\]: expected shape \(any, 2\)",
        ),
        ({"invariants": [np.eye(3)]}, "invariants: expected values by the names of shapes"),
        ({"n_jobs": 2}, "there is no option 'n_jobs'; did you mean 'jobs'"),
        ({"candidate": {}}, "there is no option 'candidate'; did you mean 'candidates'"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_its_name(given, words):
    points = np.random.default_rng(0).random((40, 3))
    with pytest.raises((InputError, OptionsError), match=words):
        align_collection({"a": points, "b": points[::-1]}, run={"jobs": 1}, progress=False, **given)
