"""Landmarks carried over a generated collection whose true places are known, as a user does it."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

import collalign
from collalign.output.loading import load
from collalign.tools.correspond import choose_template
from collalign.tools.transfer.result import (
    CARRIED,
    DOUBTFUL_POSE,
    NO_COUNTERPART,
    PLACED,
)
from data_tools.datasets.synthetic import deformed_family, planted_collection
from data_tools.datasets.synthetic_shapes import chair
from data_tools.embedding.sampling import farthest_points
from data_tools.errors import InputError
from data_tools.io.shapes import write_mesh
from data_tools.landmark_files import Landmarks, read_landmarks
from data_tools.options import SamplingOptions
from data_tools.surface.closest import SurfaceLocator
from data_tools.surface.shape import Shape
from tests.commands import read_json, read_rows, run_command
from tests.finished_runs import finished_run, on_files, radius, slicer_file
from tests.view_problems import write_result

NUM_SHAPES = 6
#: Before it is bumped and posed: its corners are landmarks.
BASE = chair(np.random.default_rng(7), resolution=2)
LANDMARK_VERTICES = farthest_points(BASE, 6, metric="euclidean")
#: Standard deviation of an expert's hand, in root mean square radii.
HAND = 0.02


def true_landmarks(planted):
    """Return every shape's landmarks in its own coordinates, shape (N, l, 3)."""
    return on_files(planted, LANDMARK_VERTICES)


def errors(found, planted):
    """Return the distances from the truth in root mean square radii, shape (N, l)."""
    units = np.array([radius(shape.vertices) for shape in planted.shapes])
    return np.asarray(np.linalg.norm(found - true_landmarks(planted), axis=2) / units[:, None])


@pytest.fixture(scope="module")
def planted():
    rng = np.random.default_rng(7)
    family = deformed_family(BASE, NUM_SHAPES, rng, rms=0.01)
    return planted_collection(family, rng, scale_range=(0.5, 2.0))


@pytest.fixture(scope="module")
def result(planted, tmp_path_factory):
    options = collalign.AlignOptions(sampling=SamplingOptions(num_points=24))
    return finished_run(tmp_path_factory.mktemp("transfer"), planted, options)


@pytest.fixture(scope="module")
def run(result):
    return collalign.RunOptions(jobs=1, store=result / "store.sqlite")


@pytest.fixture(scope="module")
def templates(planted, tmp_path_factory):
    folder = tmp_path_factory.mktemp("landmarks")
    labels = [f"tip {i}" for i in range(len(LANDMARK_VERTICES))]
    rng = np.random.default_rng(8)
    files = []
    for shape, points in list(zip(planted.shapes, true_landmarks(planted), strict=True))[:5]:
        shaken = points + HAND * radius(shape.vertices) * rng.standard_normal(points.shape)
        files.append(slicer_file(folder / f"{shape.name}.mrk.json", shaken, labels))
    return files


def test_landmarks_of_one_specimen_reach_all_others(result, templates, planted, run):
    found = collalign.landmarks.transfer_landmarks(result, templates[:1], run=run)
    np.testing.assert_array_equal(found.points[0], read_landmarks(templates[0]).points)
    assert np.median(errors(found.points, planted)[1:]) < 3 * HAND
    assert found.status[0] == (PLACED,) * 6
    assert found.status[1] == (CARRIED,) * 6


def test_sizes_in_the_common_frame_do_not_decide_which_shape_lends_its_triangles(
    result, monkeypatch
):
    module = "collalign.tools.correspond.correspond"
    monkeypatch.setattr(module, lambda session, files, lender, maps: (files, lender))
    files, chosen = collalign.maps.dense_correspondence(result, run={"jobs": 1}, progress=False)
    for factor in (0.5, 2.0):
        transform = np.array(files[chosen].transform)
        transform[:3] *= factor
        moved = [
            replace(file, transform=transform) if at == chosen else file
            for at, file in enumerate(files)
        ]
        assert choose_template(moved) == chosen
    left_out = [replace(file, incomplete=at == chosen) for at, file in enumerate(files)]
    assert choose_template(left_out) != chosen
    changed = [
        replace(file, digest="another" if at == chosen else file.digest)
        for at, file in enumerate(files)
    ]
    assert choose_template(changed) != chosen


def test_several_templates_err_less_and_know_by_how_much(result, templates, planted, run):
    one = collalign.landmarks.transfer_landmarks(result, templates[:1], run=run)
    five = collalign.landmarks.transfer_landmarks(result, templates, run=run)
    assert errors(five.points, planted)[-1].mean() < 0.8 * errors(one.points, planted)[-1].mean()
    assert np.isfinite(five.radii).all()
    for found in (one, five):
        assert (found.ellipsoids[0] == 0).all()
        lengths = np.linalg.norm(found.ellipsoids[-1], axis=2)
        assert (np.diff(lengths, axis=1) <= 0).all()
        assert (lengths > 0).all()
    assert five.left_out_errors.shape == (5, 6)
    inside = five.left_out_errors <= five.left_out_radii
    assert 0.6 <= inside.mean() <= 1


def test_the_command_writes_landmarks_tables_and_a_plot(
    result, templates, planted, tmp_path, capsys
):
    to = tmp_path / "all"
    words = [
        "transfer",
        str(result),
        "--landmarks",
        *map(str, templates),
        "--to",
        str(to),
        "--leave-one-out",
    ]
    run_command(*words, "--jobs", "1")
    last = read_landmarks(to / f"{planted.shapes[-1].name}.mrk.json")
    assert last.labels == tuple(f"tip {i}" for i in range(6))
    found = np.array(true_landmarks(planted))
    found[-1] = last.points
    assert errors(found, planted)[-1].mean() < 3 * HAND
    assert (
        f"{NUM_SHAPES} of {NUM_SHAPES} specimens have all 6 landmarks"
        in (to / "landmarks.html").read_text()
    )
    rows = read_rows(to / "transfer.csv")
    assert len(rows) == 6 * NUM_SHAPES
    assert float(rows[-1]["radius"]) > 0
    vector = [float(rows[-1][f"along_{axis}"]) for axis in "xyz"]
    assert np.isclose(np.linalg.norm(vector), float(rows[-1]["along"]))
    assert float(rows[-1]["along"]) >= float(rows[-1]["across"]) >= float(rows[-1]["normal"]) > 0
    left_out = read_rows(to / "leave_one_out.csv")
    assert len(left_out) == 30
    assert "30 landmarks of 5 templates" in capsys.readouterr().out
    cited = run_command("status", to, "--cite").out
    assert f"We aligned {NUM_SHAPES} surfaces" in cited
    assert "6 landmarks were carried to all specimens from 5 templates" in cited
    assert f"{6 * (NUM_SHAPES - 5)} landmarks were carried." in cited
    mean = np.mean([float(row["error"]) for row in left_out])
    assert f"a mean error of {mean:.3g} " in cited


def rewritten(files, folder, at, change):
    """Write landmark files anew, one of them with other labels and points."""
    folder.mkdir()
    written = []
    for number, file in enumerate(files):
        marks = read_landmarks(file)
        labels, points = list(marks.labels), np.array(marks.points)
        if number == at:
            labels, points = change(labels, points)
        written.append(slicer_file(folder / file.name, points, labels))
    return written


def swapped(labels, points):
    return labels, points[[0, 4, 2, 3, 1, 5]]


def test_a_template_with_two_landmarks_swapped_is_named_and_changes_nothing(
    result, templates, planted, tmp_path, run
):
    wrong = rewritten(templates[:3], tmp_path / "marks", 2, swapped)
    to, name = tmp_path / "all", planted.shapes[2].name
    said = run_command(
        "transfer", result, "--landmarks", *wrong, "--to", to, "--jobs", "1", "--store", run.store
    )
    assert f"Templates disagree on tip 1 and tip 4 in {name}: swapped?" in said.out
    rows = read_rows(to / "agreement.csv")
    found = {(row["template"], row["landmark"]) for row in rows if row["finding"]}
    assert found == {(name, "tip 1"), (name, "tip 4")}
    assert {row["trust"] for row in rows if row["finding"]} == {"0.0"}
    written = read_json(to / "agreement.json")
    assert np.array(written["distance"]).shape == np.array(written["trust"]).shape == (3, 6)
    assert [one["finding"] for one in written["findings"]] == ["swapped?", "swapped?"]
    assert (to / "agreement.png").read_bytes().startswith(b"\x89PNG")
    assert f"tip 1 and tip 4 in {name}: swapped?" in (to / "landmarks.html").read_text()
    both = [
        collalign.landmarks.transfer_landmarks(result, files, run=run)
        for files in (templates[:3], wrong)
    ]
    right, robust = (errors(found.points, planted)[3:].mean() for found in both)
    assert robust < right + HAND
    apart = np.linalg.norm(true_landmarks(planted)[3:, 1] - true_landmarks(planted)[3:, 4], axis=1)
    assert apart.min() > 0.3 * radius(planted.shapes[3].vertices), "a mean would be far off"


def edge_path():
    """Return vertices of the base along the shortest way over its edges between two landmarks."""
    edges = np.vstack([BASE.faces[:, [0, 1]], BASE.faces[:, [1, 2]], BASE.faces[:, [2, 0]]])
    lengths = np.linalg.norm(BASE.vertices[edges[:, 0]] - BASE.vertices[edges[:, 1]], axis=1)
    graph = coo_matrix((lengths, edges.T), shape=(len(BASE.vertices),) * 2).tocsr()
    start, end = LANDMARK_VERTICES[:2]
    before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)[1]
    path = [int(end)]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return path[::-1]


def test_curves_and_points_of_the_surface_reach_all_others(result, planted, tmp_path, run):
    path = edge_path()
    curves = []
    for at, shape in enumerate(planted.shapes[:2]):
        drawn = on_files(planted, path[:: 1 - 2 * at])[at]
        (tmp_path / "edge").mkdir(exist_ok=True)
        curves.append(tmp_path / "edge" / f"{shape.name}.fcsv")
        curves[-1].write_text(
            "".join(f"{i},{x},{y},{z}\n" for i, (x, y, z) in enumerate(drawn.tolist()))
        )
    to = tmp_path / "all"
    words = [
        "transfer",
        str(result),
        "--curves",
        *map(str, curves),
        "--curve-points",
        "9",
        "--surface-points",
        "25",
    ]
    run_command(*words, "--to", to, "--jobs", "1", "--store", run.store, "--leave-one-out")
    names = [shape.name for shape in planted.shapes]
    for at in (0, NUM_SHAPES - 1):
        found = read_landmarks(to / f"{names[at]}.mrk.json")
        rim = next(one for one in found.semilandmarks if one.name == "edge")
        assert (rim.kind, len(rim.points), len(found.points)) == ("open curve", 9, 25)
        truth, unit = on_files(planted, path)[at], radius(planted.shapes[at].vertices)
        assert np.linalg.norm(rim.points[:, None] - truth, axis=2).min(axis=1).mean() < 0.1 * unit
        assert np.linalg.norm(rim.points[[0, -1]] - truth[[0, -1]], axis=1).max() < 0.15 * unit, (
            "both drawn one way"
        )
        surface = SurfaceLocator(planted.shapes[at].vertices, planted.shapes[at].faces)
        np.testing.assert_allclose(
            surface.closest(found.points).on(surface.vertices), found.points, atol=1e-6
        )
    sliders = list(csv.reader((to / "curveslide.csv").open()))
    assert (sliders[:2], len(sliders)) == ([["before", "slide", "after"], ["1", "2", "3"]], 1 + 7)
    assert len(list(csv.reader((to / "surfaces.csv").open()))) == 26
    with pytest.raises(InputError, match="vertices"):
        collalign.landmarks.transfer_landmarks(
            result, [], curves=curves, surface_points=10**6, run=run
        )
    kept, slid = (
        collalign.landmarks.transfer_landmarks(
            result, [], curves=curves, curve_points=9, surface_points=25, run=run, slide=how
        )
        for how in (None, "bending")
    )
    ends, others = [0, 8], [at for at in range(34) if at not in (0, 8)]
    np.testing.assert_allclose(slid.points[:, ends], kept.points[:, ends])
    assert (np.abs(slid.points - kept.points)[:, others].max(axis=(0, 2)) > 0).all()
    sizes = [radius(shape.vertices) for shape in planted.shapes]
    moved = np.linalg.norm(slid.points - kept.points, axis=2) / np.array(sizes)[:, None]
    assert moved.max() < 0.3


def test_where_the_surface_ends_no_landmark_is_invented(planted, tmp_path, run):
    """A hole around one landmark takes that landmark, and no other, whether or not the shape counts as incomplete."""
    hurt, hole = planted.shapes[-1], true_landmarks(planted)[-1, 2]
    reach = np.linalg.norm(hurt.vertices - hole, axis=1) / radius(hurt.vertices)
    faces = hurt.faces[(reach[hurt.faces] > 0.25).all(axis=1)]
    used = np.unique(faces)
    left = Shape.from_arrays(hurt.vertices[used], np.searchsorted(used, faces), name=hurt.name)
    for shape in (*planted.shapes[:3], left):
        write_mesh(tmp_path / "shapes" / f"{shape.name}.ply", shape)
    options = collalign.AlignOptions(incomplete="never", sampling=SamplingOptions(num_points=24))
    collalign.align_collection(tmp_path / "shapes", options=options, run=run).save(
        tmp_path / "out", report=False
    )
    labels = tuple(f"tip {i}" for i in range(6))
    marks = {planted.shapes[0].name: Landmarks(labels=labels, points=true_landmarks(planted)[0])}
    found = collalign.landmarks.transfer_landmarks(
        tmp_path / "out", marks, surface_points=60, run=run
    )
    at = found.names.index(hurt.name)
    assert [word == NO_COUNTERPART for word in found.status[at][:6]] == [i == 2 for i in range(6)]
    assert np.isnan(found.points[at, 2]).all()
    assert set(found.status[1][:6]) == {CARRIED}
    gaps = np.linalg.norm(found.points[at, 6:] - hole, axis=1) / radius(hurt.vertices)
    assert np.nanmin(gaps) > 0.2


def test_a_doubtful_pose_gets_no_landmarks(result, templates, tmp_path, run):
    doubted = tmp_path / "doubted"
    doubted.mkdir()
    view = load(result)
    write_result(replace(view, confidence=np.array([1.0] * (NUM_SHAPES - 1) + [0.2])), doubted)
    to = tmp_path / "all"
    words = [
        "transfer",
        str(doubted),
        "--landmarks",
        str(templates[0]),
        "--to",
        str(to),
        "--jobs",
        "1",
    ]
    assert DOUBTFUL_POSE in run_command(*words, "--store", run.store, "--format", "tps", ends=3).out
    assert (to / "landmarks.tps").read_text().count("NaN") == 18


def test_a_template_in_doubt_is_not_carried_where_another_is_sure(
    result, templates, planted, tmp_path, run
):
    view = load(result)
    doubted = tmp_path / "doubted"
    confidence = np.array([0.8] + [1.0] * (NUM_SHAPES - 1))
    write_result(replace(view, confidence=confidence), doubted)
    wrong = read_landmarks(templates[0])
    shifted = Landmarks(labels=wrong.labels, points=wrong.points[::-1])
    marks = {planted.shapes[0].name: shifted, planted.shapes[1].name: read_landmarks(templates[1])}

    def carried(given):
        return collalign.landmarks.transfer_landmarks(doubted, given, run=run, progress=False)

    found, alone = carried(marks), carried({planted.shapes[1].name: marks[planted.shapes[1].name]})
    np.testing.assert_array_equal(found.points[2:], alone.points[2:])
    np.testing.assert_array_equal(found.points[0], shifted.points)  # its own stay
    assert found.templates == (planted.shapes[1].name,)
    (note,) = [note for note in found.notes if note.code == "templates-doubtful"]
    assert (note.shapes, note.values["counted"]) == ((planted.shapes[0].name,), False)
    assert not any(note.code == "templates-doubtful" for note in alone.notes)
    only = carried({planted.shapes[0].name: wrong})
    (note,) = [note for note in only.notes if note.code == "templates-doubtful"]
    assert note.values["counted"]
    assert {*only.status[-1]} == {CARRIED}
