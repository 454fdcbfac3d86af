"""Range scans of one object from points to poses, and complete open shapes, which are no scans."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import Delaunay

from collalign import AlignOptions, RunOptions, align_collection
from collalign.engine.session import Session
from collalign.stages.incomplete import scan_pairs
from collalign.stages.incomplete import scans as scanning
from collalign.stages.incomplete.scans import (
    BADLY_MATCHED,
    match_badly,
    were_seen,
)
from collalign.stages.match_pairs import match_pairs
from collalign.stages.shape_stage import prepare_shapes
from data_tools.datasets.synthetic import deformed_family, range_view
from data_tools.datasets.synthetic_shapes import blob, crown
from data_tools.embedding import surface_points
from data_tools.errors import CollectionError, InputError, OptionsError
from data_tools.io.objects import list_shapes
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation
from data_tools.sight import lines_that_saw
from tests.commands import read_json, run_command
from tests.finished_runs import angles_deg
from tests.notes import codes
from tests.products import pair_of

NUM = 8
OPTIONS = AlignOptions(group="SO", sampling=SamplingOptions(num_points=24, num_dense_points=100))


@pytest.fixture(scope="module")
def views():
    """Clouds that a camera sees of a blob from all around, each moved, and the rotation of each."""
    rng = np.random.default_rng(6)
    whole = blob(np.random.default_rng(1), num_vertices=1500)
    turns, clouds = np.stack([random_rotation(rng) for _ in range(NUM)]), {}
    for i, angle in enumerate(2.0 * np.pi * np.arange(NUM) / NUM):
        points = range_view(
            whole, np.array([np.cos(angle), np.sin(angle), 0.2]), noise=0.002, rng=rng
        )
        clouds[f"view{i}"] = points @ turns[i].T + rng.standard_normal(3)
    return clouds, turns


@pytest.fixture(scope="module")
def aligned(tmp_path_factory):
    """Aligns; all runs match the same pairs once."""
    run = RunOptions(jobs=1, store=tmp_path_factory.mktemp("store") / "store.sqlite")

    def align(clouds, fixed=None, order=(), **options):
        asked = replace(OPTIONS, **options)
        return align_collection(
            clouds, options=asked, fixed=fixed, run=run, progress=False, order=order
        )

    return align


@pytest.fixture(scope="module")
def by_default(views, aligned):
    return aligned(views[0])


def test_scans_are_recognised_and_posed_by_default(by_default, views):
    assert angles_deg(by_default.rotations @ views[1])[0].max() < 2.0
    assert by_default.confidence.min() > 0.95
    assert [one.shape for one in by_default.incomplete] == [*range(NUM)]
    assert all(one.reason == "scan" for one in by_default.incomplete)
    assert "all-incomplete" in codes(by_default.notes)


@pytest.mark.parametrize("first", [False, True])
def test_a_cloud_of_few_points_hides_no_scans(views, by_default, aligned, first):
    few = {"few": views[0]["view3"][:18]}
    found = aligned({**few, **views[0]} if first else {**views[0], **few})
    scans = [found.names.index(name) for name in by_default.names]
    assert angles_deg(found.rotations[scans] @ views[1])[0].max() < 2.0
    np.testing.assert_array_equal(found.confidence[scans], by_default.confidence)
    assert found.confidence[found.names.index("few")] == 0.0
    assert sorted(np.bincount(found.part_numbers).tolist()) == [1, NUM]
    assert "unjoined-scans" in codes(found.notes)
    with pytest.raises(CollectionError, match="few: too few points to describe"):
        aligned({**views[0], **few}, incomplete="all")


def test_scans_overlap_with_their_neighbours_and_sizes_stay(by_default):
    scales = np.cbrt(np.linalg.det(by_default.transforms[:, :3, :3]))
    np.testing.assert_allclose(scales, scales[0])
    for one in by_default.incomplete:
        assert {(one.shape - 1) % NUM, (one.shape + 1) % NUM} <= {*one.partners.tolist()}
        beside = np.isin(one.partners, [(one.shape - 1) % NUM, (one.shape + 1) % NUM])
        assert one.overlaps[beside].min() > 0.4
    labels = by_default.maps.labels
    assert labels.max() < len(by_default.consensus)
    near, far = (len({*labels[0].tolist()} & {*labels[j].tolist()} - {-1}) for j in (1, NUM // 2))
    assert near > far


def test_pairs_of_scans_say_what_they_share(by_default):
    kept = [pair for pair in by_default.pairs if pair.inlier]
    assert {(i, i + 1) for i in range(NUM - 1)} <= {(pair.target, pair.source) for pair in kept}
    for pair in by_default.pairs:
        assert (pair.choice >= 0) == pair.inlier
        assert ((pair.energies >= 0) & (pair.energies <= 1)).all()


def test_fixed_poses_are_refused_for_scans(views, aligned):
    with pytest.raises(InputError, match="without fixed poses"):
        aligned(views[0], fixed={"view0": np.eye(3)}, incomplete="all")


def test_scans_that_overlaps_do_not_join_surely_are_posed_as_whole_shapes(
    views, aligned, monkeypatch
):
    few = dict([*views[0].items()][::4]) | {"view2": views[0]["view2"]}
    monkeypatch.setattr(scanning, "MOST_SURE", 1.1)
    assert "all-incomplete" in codes(aligned(few).notes), "all were seen from one direction each"
    monkeypatch.setattr(scanning, "BADLY_MATCHED", 1.1)
    monkeypatch.setattr(scanning, "NEARLY_ALL", 1.1)
    assert "all-incomplete" not in codes(aligned(few).notes)


def test_scans_that_nobody_called_so_and_no_direction_saw_are_in_doubt(
    views, by_default, aligned, monkeypatch
):
    monkeypatch.setattr(scanning, "were_seen", lambda shapes: False)
    guessed = aligned(views[0])
    np.testing.assert_array_equal(guessed.transforms, by_default.transforms)
    share = scanning.OVERLAP_ALONE
    np.testing.assert_array_equal(guessed.confidence, share * by_default.confidence)
    assert {*guessed.limited_by.values()} == {"overlap-alone"}
    called = aligned(views[0], incomplete="all")
    np.testing.assert_array_equal(called.confidence, by_default.confidence)


@pytest.mark.parametrize("is_known", [False, True])
def test_a_cloud_that_was_seen_from_the_other_side_than_guessed_is_joined(
    views, aligned, monkeypatch, is_known
):
    clouds, guess = {name: points + 1.0 for name, points in views[0].items()}, lines_that_saw
    wrong = len(clouds["view0"])
    assert sum(len(points) == wrong for points in clouds.values()) == 1
    monkeypatch.setattr(
        surface_points,
        "lines_that_saw",
        lambda shape: -guess(shape) if len(shape.vertices) == wrong else guess(shape),
    )
    monkeypatch.setattr(scanning, "side_known", lambda shapes, scan: is_known)
    collection = aligned(clouds, incomplete="all")
    if is_known:
        assert np.flatnonzero(collection.part_numbers).tolist() == [0]
    else:
        assert (collection.part_numbers == 0).all()
        assert angles_deg(collection.rotations @ views[1])[0].max() < 2.0
        assert collection.confidence.min() > 0.95


def test_a_scan_in_pieces_that_is_in_doubt_is_named(views, aligned, monkeypatch):
    clouds, turns = views
    from_front = clouds["view0"] @ turns[0]  # the camera looks along x
    faces = Delaunay(from_front[:, 1:]).simplices
    middles = from_front[faces].mean(axis=1)[:, 1]
    faces = faces[np.abs(middles - np.quantile(middles, 0.3)) > 0.05 * np.ptp(middles)]  # a gap
    monkeypatch.setattr(scanning, "DOUBT", 1.1)
    in_pieces = {**clouds, "view0": (clouds["view0"], faces)}
    assert aligned(in_pieces, incomplete="all").assembled == ("view0",)
    collection = aligned(in_pieces, incomplete="all", cleaning={"components": "largest"})
    assert [one.shapes for one in collection.notes if one.code == "components-left-out"] == [
        ("view0",)
    ]


def test_complete_open_shapes_are_no_scans():
    rng = np.random.default_rng(2)
    teeth = deformed_family(crown(rng, num_vertices=500), 4, rng, rms=0.03)
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepare_shapes(
            session, list_shapes([replace(t, name=f"t{i}") for i, t in enumerate(teeth)])
        )
        pairs, _ = match_pairs(session, shapes, np.array([[0, 1], [0, 2], [1, 3], [2, 3]]))
    assert all(item.rim == "open" for item in shapes.samples)
    assert not were_seen(shapes)
    assert not match_badly(shapes, pairs)
    assert np.median([pair.mismatches.min() for pair in pairs]) < BADLY_MATCHED - 0.1


def test_shapes_may_be_scans_where_most_are_open_and_match_badly():
    def said(rims, mismatches, num_seen=0, num_points=100):
        points = np.zeros((num_points, 3))
        local = [
            SimpleNamespace(points=points, sights=np.zeros((int(n < num_seen), 3)))
            for n in range(len(rims))
        ]
        samples = [
            SimpleNamespace(may_be_cut=rim != "closed", local=one)
            for rim, one in zip(rims, local, strict=True)
        ]
        shapes = SimpleNamespace(names=rims, samples=samples)
        pairs = [pair_of(np.eye(3), [0.1], mismatches=np.array(own)) for own in mismatches]
        return match_badly(shapes, pairs) or were_seen(shapes)

    assert said(["open"] * 3, [[0.8]] * 3)
    assert said(["open", "unknown", "closed"], [[0.8], [0.9], [0.2]])
    assert not said(["open"] * 3, [[0.7]] * 3)
    assert not said(["open", "closed", "closed"], [[0.8]] * 3)
    assert not said(["open"] * 3, [[0.8], [0.8], []])
    assert not said(["open"] * 3, [[np.nan]] * 3)
    assert not said(["open"] * 2, [[0.8]])
    assert said(["open"] * 3, [[0.5]] * 3, num_seen=2)
    assert not said(["open"] * 3, [[0.5]] * 3, num_seen=1)
    assert not said(["closed"] * 3, [[0.5]] * 3, num_seen=3)
    assert not said(["open"] * 3, [[0.8]] * 3, num_points=99)


def test_shapes_that_were_all_seen_from_the_front_are_no_scans():
    def are_scans(sights, mismatch):
        joined = SimpleNamespace(
            confidence=np.ones(3), parts=[np.arange(3)], transforms=np.tile(np.eye(4), (3, 1, 1))
        )
        surfaces = [SimpleNamespace(sights=np.array([sight])) for sight in sights]
        pairs = [pair_of(np.eye(3), [0.1], mismatches=np.array([mismatch]))]
        return scanning._are_scans(joined, surfaces, pairs, are_seen=True, is_scene=False)

    front = [[0.0, 0.1, 1.0], [0.1, 0.0, 1.0], [0.0, 0.0, 1.0]]
    assert not are_scans(front, 0.5)
    assert are_scans(np.eye(3), 0.5)
    assert are_scans(front, 0.9)


def test_images_of_a_scene_lie_apart_and_whole_hollow_shapes_on_each_other():
    points = np.random.default_rng(0).standard_normal((50, 3))
    surfaces = [SimpleNamespace(points=points, sights=np.empty((0, 3)))] * 3

    def are_scans(apart, *confidence):
        transforms = np.tile(np.eye(4), (3, 1, 1))
        transforms[:, 0, 3] = apart * np.arange(3)
        joined = SimpleNamespace(
            confidence=np.array(confidence), parts=[np.arange(3)], transforms=transforms
        )
        return scanning._are_scans(joined, surfaces, (), are_seen=True, is_scene=True)

    assert are_scans(2.0, 0.6, 0.6, 0.0)
    assert not are_scans(2.0, 0.6, 0.0, 0.0)
    assert not are_scans(0.1, 0.99, 0.99, 0.99)


def test_the_order_of_scans_is_a_hint(views, aligned):
    names = [f"view{i}" for i in (2, 0, 1)]
    few = {name: views[0][name] for name in names}
    found = aligned(few, incomplete="all", order=names)
    [given] = [note for note in found.notes if note.code == "given"]
    assert given.values["num_ordered"] == 3
    with pytest.raises(OptionsError, match="order: only scans"):
        aligned(few, order=names)


def test_the_order_of_scans_is_told_on_the_command_line(views, tmp_path):
    folder = tmp_path / "scans"
    folder.mkdir()
    for name, points in list(views[0].items())[:3]:
        np.savetxt(folder / f"{name}.xyz", points)
    words = "align", folder, "--out", tmp_path / "out", "--scaling", "rigid", "--group", "SO"
    words = *words, "--incomplete", "all", "--jobs", "1", "--no-report", "--order"
    said = run_command(*words, "view0,view9", ends=2)
    assert "order: no shape is called 'view9'" in said.err
    run_command(*words, "view0", ends=2)
    run_command(*words, "names")
    notes = read_json(tmp_path / "out" / "alignment.json")["notes"]
    assert [note["values"]["num_ordered"] for note in notes if note["code"] == "given"] == [3]


def test_a_scan_far_larger_than_most_is_named_or_left_alone(views, aligned, monkeypatch):
    monkeypatch.setattr(scan_pairs, "MOST_DESCRIBED", 940)  # one cloud has so many points
    with pytest.raises(CollectionError, match=r"^view2: far larger than most scans, .* unit\?$"):
        aligned(views[0], incomplete="all")
    found = aligned(views[0])
    assert np.flatnonzero(found.part_numbers).tolist() == [2]
    others = np.arange(NUM) != 2
    assert angles_deg(found.rotations[others] @ views[1][others])[0].max() < 2.0
