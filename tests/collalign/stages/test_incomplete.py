"""Incomplete shapes of a collection: told or found, posed on the complete ones, which stay as without them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions, add_to_collection, align_collection, load
from collalign.confidence.incomplete_model import (
    is_other_body,
    is_unlike,
    log_odds,
    share_of_best,
)
from collalign.engine.session import Session
from collalign.products.shapes import Constraints
from collalign.products.trust import DOUBT
from collalign.stages import steps
from collalign.stages.evidence.weigh import by_energy
from collalign.stages.incomplete.add import chances_as_parts
from collalign.stages.incomplete.detect import (
    LIKELIER,
    find_incomplete,
    named_incomplete,
    share_beyond,
)
from collalign.stages.incomplete.place import (
    nearest_labels,
    place_shape,
    pose_evidence,
    sizes_of_complete,
)
from collalign.stages.incomplete.scans import common_points
from collalign.stages.posing import _found_incomplete, _likelier_as_parts, _may_be_scans
from collalign.stages.shape_stage import prepare_shapes
from collalign.stages.steps import Matched, Run
from collalign.stages.trust.assess import gather_trust
from data_tools.datasets.synthetic import bumped, deformed_family
from data_tools.datasets.synthetic_shapes import blob, chair, crown
from data_tools.embedding.surface_points import spread_points
from data_tools.errors import InputError, OptionsError
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.notes import Note
from data_tools.options import SamplingOptions
from data_tools.partial_surface import PartialSurface
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.cleaning import COMPONENTS_KEPT
from experiments.calibration.fragments import closed
from pairwise.partial_counterparts import counterparts
from tests.commands import read_json
from tests.finished_runs import angles_deg
from tests.notes import only
from tests.pairwise.test_partial_match import cut, moved, surface
from tests.products import settled_pair_of, shapes_of

pytestmark = pytest.mark.usefixtures("quick_search")
OPTIONS = AlignOptions(group="SO", sampling=SamplingOptions(num_points=24, num_dense_points=200))
BROKEN = ("tooth2",)


def align(shapes, store=None, **options):
    return align_collection(
        shapes, options=replace(OPTIONS, **options), jobs=1, store=store, progress=False
    )


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    """Five teeth in random poses, one of them without a quarter, and the turn of each."""
    rng = np.random.default_rng(11)
    folder = tmp_path_factory.mktemp("teeth")
    teeth = deformed_family(crown(rng, num_vertices=600), 5, rng, rms=0.015)
    turns = np.stack([random_rotation(rng) for _ in teeth])
    for number, (tooth, turn) in enumerate(zip(teeth, turns, strict=True)):
        name = f"tooth{number}"
        part = cut(tooth, rng.standard_normal(3), 0.25) if name in BROKEN else tooth
        write_mesh(
            folder / f"{name}.ply", moved(part, turn, rng.uniform(0.5, 2.0), rng.standard_normal(3))
        )
    return folder, turns


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """What the run of :func:`aligned` and one that places a tooth by hand share."""
    return tmp_path_factory.mktemp("store") / "store.sqlite"


@pytest.fixture(scope="module")
def aligned(planted, store):
    return align(planted[0], store=store, incomplete="tooth2, ")


@pytest.fixture(scope="module")
def without(planted):
    """The whole teeth alone."""
    files = [file for file in sorted(planted[0].glob("*.ply")) if file.stem not in BROKEN]
    return align(files)


def test_broken_teeth_are_posed_on_the_whole_ones(aligned, planted):
    assert angles_deg(aligned.rotations @ planted[1])[0].max() < 12
    assert [aligned.names[one.shape] for one in aligned.incomplete] == list(BROKEN)
    for one in aligned.incomplete:
        assert 0.5 < one.coverage < 0.95
        assert (one.overlaps[:, 1] > one.overlaps[:, 0]).mean() > 0.5
        assert aligned.confidence[one.shape] > 0.5
    note = only(aligned.notes, "incomplete")
    assert note.shapes == BROKEN
    assert note.values["reasons"] == ("named",) * len(BROKEN)
    assert note.values["coverages"] == tuple(one.coverage for one in aligned.incomplete)
    assert np.isfinite(aligned.consensus).all()


def test_a_piece_is_no_surer_than_the_shapes_it_lies_on(planted, store, monkeypatch):
    monkeypatch.setattr("collalign.stages.incomplete.add.pose_chance", lambda record: 1.0)
    sure = align(planted[0], store=store, incomplete="tooth2, ")
    whole = np.delete(sure.confidence, 2)
    assert sure.confidence[2] == pytest.approx(whole.mean())
    assert whole.mean() < 1.0


def test_clouds_are_placed_as_well_and_resemble_their_kind(planted):
    teeth = [read_shape(file) for file in sorted(planted[0].glob("*.ply"))]
    clouds = [spread_points(replace(one, faces=np.empty((0, 3), int)), 300) for one in teeth]
    assert not any(cloud.oriented for cloud in clouds)
    poses = [
        Similarity(
            rotation=turn.T,
            scale=1.0 / cloud.radius,
            shift=-turn.T @ cloud.points.mean(axis=0) / cloud.radius,
        ).transform
        for cloud, turn in zip(clouds, planted[1], strict=True)
    ]
    whole = [0, 1, 3, 4]
    found = place_shape(
        clouds[2], tuple(clouds[i] for i in whole), np.stack(poses)[whole], "SO", True
    )
    assert rotation_angle_deg(found["rotations"][0], planted[1][2].T) < 15
    assert found["mismatch"] < 0.6
    assert found["likeness"] > 0.8
    assert not is_unlike(found["mismatch"], found["likeness"], found["evidence"][1, 0])
    small = chair(np.random.default_rng(0))
    small = spread_points(replace(small, vertices=0.5 * small.vertices), 300)
    stranger = place_shape(
        small, tuple(clouds[i] for i in whole), np.stack(poses)[whole], "SO", True
    )
    assert stranger["likeness"] < 0.8
    assert is_unlike(0.3, stranger["likeness"], stranger["evidence"][1, 0])


def test_points_that_tell_nothing_are_placed_in_the_middle_in_doubt(planted):
    tooth = spread_points(read_shape(planted[0] / "tooth0.ply"), 300)
    other = PartialSurface(
        points=tooth.points, normals=tooth.normals, on_rim=tooth.on_rim, oriented=True
    )
    few = replace(
        other, points=other.points[:4], normals=other.normals[:4], on_rim=other.on_rim[:4]
    )
    found = place_shape(few, (other, other), np.tile(np.eye(4), (2, 1, 1)), "SO", False)
    assert len(found["rotations"]) == 1
    assert np.isnan(found["mismatch"])
    assert is_unlike(found["mismatch"], 1.0, -0.2)
    in_micrometres = replace(few, points=1000.0 * few.points)
    found = place_shape(in_micrometres, (other,), np.eye(4)[None], "SO", True)
    radius = np.cbrt(np.linalg.det(found["transforms"][0, :3, :3])) * in_micrometres.radius
    assert 0.2 < radius / other.radius < 5.0


def test_missing_regions_have_no_labels(aligned):
    labels = aligned.maps.labels
    for shape, name in enumerate(aligned.names):
        there = labels[shape] >= 0
        assert there.all() == (name not in BROKEN)
        assert len(set(labels[shape][there])) == there.sum() >= 8
    onto = aligned.maps["tooth2", "tooth0"]
    lacking = np.flatnonzero(onto < 0)
    assert len(lacking) == 24 - (labels[2] >= 0).sum()
    distances = np.linalg.norm(aligned.positions[0][:, None] - aligned.positions[2], axis=2).min(
        axis=1
    )
    assert distances[lacking].mean() > distances[onto >= 0].mean()


def test_the_complete_shapes_stay_as_they_are_without_the_broken_ones(aligned, without):
    kept = [aligned.names.index(name) for name in without.names]
    np.testing.assert_array_equal(aligned.transforms[kept], without.transforms)
    np.testing.assert_array_equal(aligned.maps.labels[kept], without.maps.labels)
    np.testing.assert_array_equal(aligned.consensus, without.consensus)


def test_the_result_says_what_is_missing_and_takes_more(aligned, planted, tmp_path):
    aligned.save(tmp_path / "out")
    record = read_json(tmp_path / "out" / "alignment.json")
    assert [one["name"] for one in record["incomplete"]] == list(BROKEN)
    assert set(record["incomplete"][0]["overlaps"]) <= {"tooth0", "tooth1", "tooth3", "tooth4"}
    view = load(tmp_path / "out")
    assert np.isnan(view.landmarks).any(axis=(1, 2)).tolist() == [
        name in BROKEN for name in aligned.names
    ]
    fresh, known = tmp_path / "fresh", read_shape(planted[0] / "tooth0.ply")
    write_mesh(
        fresh / "new.ply", moved(known, np.eye(3), 1.1, np.zeros(3))
    )  # a copy would be skipped
    more = add_to_collection(tmp_path / "out", fresh, run={"jobs": 1}, progress=False)
    np.testing.assert_array_equal(more.transforms[:5], aligned.transforms)
    assert rotation_angle_deg(more.rotations[5], more.rotations[0]) < 2
    assert [more.names[one.shape] for one in more.incomplete] == list(BROKEN)


def test_a_tooth_that_is_placed_by_hand_stays_there_and_the_others_where_they_were(aligned, store):
    at = aligned.names.index("tooth2")
    size, shift = 1.1 * aligned.scales[at], np.array([0.1, 0.0, 0.0])
    by_hand = Similarity(rotation=aligned.rotations[1], scale=size, shift=shift)
    fixed = dict(zip(aligned.names, aligned.transforms, strict=True)) | {
        "tooth2": by_hand.transform
    }
    again = align_collection(
        aligned.files, options=aligned.options, fixed=fixed, jobs=1, store=store, progress=False
    )
    np.testing.assert_array_equal(again.transforms, np.stack([*fixed.values()]))
    assert [again.names[one.shape] for one in again.incomplete] == list(BROKEN)
    assert again.coverage[at] != aligned.coverage[at]
    offered = aligned.alternatives[at][0]
    np.testing.assert_allclose(
        Similarity.of_transforms(offered.transform).rotation, offered.rotation, atol=1e-12
    )
    for pose, words in [(np.ones((4, 4)), "not the transform"), (by_hand.transform, "sizes stay")]:
        options = replace(aligned.options, scaling="rigid")
        with pytest.raises(InputError, match=rf"fixed\[tooth2\]: .*{words}"):
            align_collection(aligned.files, options=options, fixed={"tooth2": pose}, progress=False)


def test_names_are_checked(planted):
    with pytest.raises(InputError, match="'tooth9'"):
        named_incomplete(replace(OPTIONS, incomplete="tooth9"), ["tooth1"])
    assert named_incomplete(replace(OPTIONS, incomplete="never"), ["tooth1"]) == {}
    assert named_incomplete(OPTIONS, ["tooth0", "tooth1"], ["tooth1"]).keys() == {1}
    with pytest.raises(OptionsError, match="incomplete"):
        AlignOptions(incomplete=3)
    with pytest.raises(InputError, match="reference"):
        align(planted[0], incomplete="tooth2", reference="tooth2")


def test_a_broken_tooth_is_found_among_seven(tmp_path, monkeypatch):
    judged = []

    def counted(session, samples, *posed):
        judged.append(len(samples))
        return gather_trust(session, samples, *posed)

    monkeypatch.setattr("collalign.stages.steps.gather_trust", counted)
    rng = np.random.default_rng(3)
    teeth = deformed_family(crown(rng, num_vertices=600), 7, rng, rms=0.012)
    for number, tooth in enumerate(teeth):
        part = cut(tooth, np.array([1.0, 0.3, 0.2]), 0.25) if number == 4 else tooth
        write_mesh(
            tmp_path / f"tooth{number}.ply", moved(part, random_rotation(rng), 1.0, np.zeros(3))
        )
    aligned = align(tmp_path, sampling=SamplingOptions(num_points=24, num_dense_points=400))
    assert [aligned.names[one.shape] for one in aligned.incomplete] == ["tooth4"]
    assert aligned.incomplete[0].reason == "cut-off"
    assert judged == [6]  # confidences of poses that are thrown away are not computed


def test_a_shape_that_seems_incomplete_among_too_few_is_in_doubt(
    planted, without, store, monkeypatch
):
    monkeypatch.setattr(
        "collalign.stages.posing.find_incomplete", lambda *_: {2: "cut-off", 4: "cut-off"}
    )
    monkeypatch.setattr("collalign.stages.posing.align_parts", lambda *_: None)
    aligned = align(planted[0], store=store)
    assert not aligned.incomplete
    assert aligned.confidence.max() > DOUBT, "or there would be nothing to limit"
    assert aligned.confidence[[2, 4]].max() < DOUBT
    limits = aligned.limited_by
    assert {aligned.names[at] for at in (2, 4)} == {n for n in limits if limits[n] == "cut-off"}


def test_nothing_is_missing_among_whole_teeth(without):
    assert not without.incomplete
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        few = prepare_shapes(session, list_shapes([Path(file) for file in without.files[:3]]))
        assert find_incomplete(session, few, without.pairs[:0], without.transforms[:3]) == {}


def test_a_piece_that_matches_better_than_usual_is_of_the_kind_though_its_break_is_closed():
    assert is_unlike(0.4, 0.7, -0.01)
    assert not is_unlike(0.4, 0.7, -0.1)
    assert not is_unlike(0.4, 0.9, -0.01)


def test_a_body_that_covers_little_is_a_stranger_and_a_piece_with_a_long_rim_is_none():
    assert is_other_body(0.04, 0.09, 1.4)
    assert not is_other_body(0.04, 0.19, 1.4)
    assert not is_other_body(0.3, 0.09, 1.4)
    assert not is_other_body(0.04, 0.09, 0.2)
    assert not is_other_body(0.04, 0.09, np.nan)


def test_a_rival_that_partners_like_nearly_as_much_takes_certainty():
    turns = np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0])])
    sure, close = (
        share_of_best(turns, log_odds(np.array([[0.1, own], [0.0, 0.0], [0.0, 0.0]])))
        for own in (0.8, 0.11)
    )
    assert close < 0.6 < 0.95 < sure
    assert share_of_best(turns[[0, 0, 1]], np.zeros(3)) == pytest.approx(2 / 3)


def test_a_closed_break_counts_against_no_pose_and_roughness_against_none_more_than_others():
    rng = np.random.default_rng(3)
    whole = blob(rng, num_vertices=800)
    targets = [surface(one) for one in deformed_family(whole, 3, rng, rms=0.01)]
    half_turns = [np.eye(3), *(np.diag(2.0 * axis - 1.0) for axis in np.eye(3))]
    poses = Similarity.rigid(np.stack(half_turns), np.zeros((4, 3)))
    broken = cut(bumped(whole, rng, rms=0.01), np.array([1.0, 0.0, 0.0]), 0.5)
    pieces = {"open": broken, "closed": closed(broken, rng)}
    rough = broken.vertices + 0.02 * rng.standard_normal(broken.vertices.shape)
    pieces["rough"] = replace(broken, vertices=rough)
    for kind, piece in pieces.items():
        source = surface(piece)
        found = [counterparts(target, source, poses, 300) for target in targets]
        evidence = pose_evidence(targets, source, poses, found)
        assert np.argmax(log_odds(evidence)) == 0, kind
        assert evidence[1, 0] < 0.05, kind
        assert evidence[2].any() == (kind != "closed"), kind


def test_sizes_of_complete_shapes_say_how_large_a_piece_is_where_they_are_alike():
    alike, apart = (
        np.eye(4) * [[[size] * 3 + [1.0]] for size in sizes] for sizes in ((0.9, 1, 1.1), (1, 2))
    )
    low, high = sizes_of_complete(alike, estimate_scale=True)
    assert low < 0.9 < 1.1 < high < 1.5
    assert [
        sizes_of_complete(apart, estimate_scale=True),
        sizes_of_complete(alike, estimate_scale=False),
    ] == [
        None,
        (1.0, 1.0),
    ]


def test_samples_far_from_everything_get_no_label():
    consensus = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    labels = nearest_labels(
        np.array([[2.1, 0.0, 0.0], [9.0, 0.0, 0.0], [0.1, 0.2, 0.0]]), consensus
    )
    assert labels.tolist() == [2, -1, 0]


def test_only_poses_of_what_may_be_cut_off_are_refined(monkeypatch):
    rng = np.random.default_rng(2)
    crowns = [crown(rng, num_vertices=400) for _ in range(4)]
    partners = [surface(one) for one in crowns[1:]]
    broken = surface(cut(crowns[0], np.array([1.0, 0.0, 0.0]), 0.3))
    assert share_beyond(broken, partners) > 0.1
    monkeypatch.setattr(
        "collalign.stages.incomplete.detect.refine", lambda *_, **__: pytest.fail("refined")
    )
    assert share_beyond(surface(crowns[0]), partners) < 0.04
    with pytest.raises(pytest.fail.Exception):
        share_beyond(broken, partners)


def test_closed_surfaces_and_shapes_that_bend_lack_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "collalign.stages.incomplete.detect.share_beyond", lambda surface, partners: 0.2
    )
    monkeypatch.setattr("collalign.stages.incomplete.detect.MOST_MISSING", 1.0)
    every = [4]  # which of its points are on the rim
    monkeypatch.setattr(
        "collalign.stages.incomplete.detect.cloud_rim",
        lambda points, _: np.arange(len(points)) % every[0] == 0,
    )
    rng = np.random.default_rng(4)
    for number in range(5):
        write_mesh(tmp_path / f"blob{number}.ply", blob(np.random.default_rng(1), num_vertices=400))
    clouds = {f"cloud{n}": blob(rng, num_vertices=400).vertices for n in range(5)}
    poses, pairs = (
        np.tile(np.eye(4), (5, 1, 1)),
        [settled_pair_of(np.eye(3), [0.1], source=n) for n in range(1, 5)],
    )
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        for given, lacking in ((tmp_path, []), (clouds, [0, 1, 2, 3, 4])):
            shapes = prepare_shapes(session, list_shapes(given))
            assert list(find_incomplete(session, shapes, pairs, poses)) == lacking
        every[0] = 2
        assert not find_incomplete(session, shapes, pairs, poses), "a rim is no half of a shape"
        every[0] = 4
        run = run_of(session, shapes)
        bent = Matched(group="SO", pairs=[by_energy(pairs[0])], failed=[], solution=None, notes=())
        assert _found_incomplete(run, {}, (run, bent, None)) == ({}, {})


def test_an_open_shape_in_doubt_is_read_as_a_part_where_that_is_surer(planted):
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepare_shapes(session, list_shapes(planted[0]))
        run = run_of(session, shapes)
        decided, matched = steps.match(run)
        posed = steps.state_trust(decided, steps.pose(decided, matched))
        broken = shapes.names.index(BROKEN[0])

        def likelier(stated, shapes=shapes):
            confidence = np.full(len(shapes.names), 0.95)
            confidence[broken] = stated
            solution = replace(posed.solution, confidence=confidence)
            answer = replace(decided, shapes=shapes), matched, replace(posed, solution=solution)
            return _likelier_as_parts(run, {}, answer)

        assert likelier(0.2) == {broken: LIKELIER}
        assert likelier(0.6) == {}, "it is likelier to be right"
        closed_samples = tuple(replace(item, rim="closed") for item in shapes.samples)
        assert likelier(0.2, replace(shapes, samples=closed_samples)) == {}
        posed = replace(posed, solution=replace(posed.solution, confidence=np.full(5, 0.1)))
        assert chances_as_parts(decided, posed, [broken])[broken] <= 0.1 + 1e-9, (
            "no surer than those that it lies on"
        )
        alone = replace(posed.solution, parts=(np.array([broken]),))
        nobody = replace(posed, solution=alone)
        assert chances_as_parts(decided, nobody, [broken]) == {broken: 0.0}


@pytest.mark.parametrize(
    ("options", "cut", "tries"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"incomplete": "never"}, True, False),
        ({"synchronization": "spectral"}, True, False),
        ({"deformable": True}, True, False),
    ],
)
def test_shapes_are_tried_as_scans_where_nobody_said_otherwise(options, cut, tries):
    run = unmatched_run(
        AlignOptions(**options), SimpleNamespace(may_be_cut=cut, notes=(), local=None)
    )
    assert _may_be_scans(run) == tries
    run.shapes.names = "a" * 200
    assert _may_be_scans(run) == tries
    for names in ("ab", "a" * 201):
        run.shapes.names = names
        assert not _may_be_scans(run), "too few or too many"


@pytest.mark.parametrize("seen", [False, True])
def test_assembled_objects_are_tried_as_scans_where_they_were_seen_from_one_side(seen):
    local = SimpleNamespace(sights=np.eye(3)[: int(seen)], points=np.zeros((500, 3)))
    run = unmatched_run(AlignOptions(), SimpleNamespace(may_be_cut=True, notes=(), local=local))
    run.shapes.are_assembled = True
    assert _may_be_scans(run) == seen


def run_of(session, shapes):
    """Return a run of shapes about which nothing is known."""
    return Run(
        session=session,
        shapes=shapes,
        read_without=lambda _: shapes,
        constraints=Constraints(),
        former=None,
        times_s={},
    )


def unmatched_run(options, sample):
    """Return what is asked of a run of four such shapes before any pair is matched."""
    shapes = SimpleNamespace(names="abcd", samples=[sample] * 4, are_assembled=False)
    session = SimpleNamespace(options=options)
    return SimpleNamespace(session=session, shapes=shapes, constraints=Constraints())


def test_points_that_stand_for_all_samples_lie_apart():
    rng = np.random.default_rng(0)
    positions = rng.random((3, 30, 3))
    universe = common_points(positions)
    spacing = np.median(
        [np.sort(np.linalg.norm(p[:, None] - p, axis=2), axis=1)[:, 1] for p in positions]
    )
    gaps = np.linalg.norm(universe[:, None] - universe, axis=2) + 9.0 * np.eye(len(universe))
    assert gaps.min() > spacing
    far = np.linalg.norm(positions.reshape(-1, 1, 3) - universe, axis=2).min(axis=1)
    assert far.max() <= spacing


@pytest.mark.parametrize("joined", [False, True])
def test_borders_of_assembled_objects_are_no_breaks(joined):
    """Neither where all components are matched, nor where most of the surface is left out."""
    lost = () if joined else (Note(COMPONENTS_KEPT, values={"share": 60}),)
    samples = [SimpleNamespace(rim="open", notes=lost)] * 7
    shapes = shapes_of(samples, "all" if joined else "largest")
    assert find_incomplete(None, shapes, (), np.eye(4)[None]) == {}


def test_parts_of_which_none_is_whole_are_put_together(tmp_path):
    rng = np.random.default_rng(8)
    whole = blob(rng, num_vertices=700)
    rotations = np.stack([random_rotation(rng) for _ in range(3)])
    for number, (rotation, side) in enumerate(zip(rotations, np.eye(3), strict=True)):
        part = moved(cut(whole, side, 0.3), rotation, 1.0, rng.standard_normal(3))
        write_mesh(tmp_path / f"scan{number}.ply", part)
    aligned = align(tmp_path, incomplete="all", scaling="rigid")
    assert angles_deg(aligned.rotations @ rotations)[0].max() < 5
    assert len(aligned.incomplete) == 3
    assert (aligned.maps.labels >= 0).mean() > 0.6
    assert aligned.maps.labels.max() < len(aligned.consensus)
    shared = [
        len(set(aligned.maps.labels[i]) & set(aligned.maps.labels[j]))
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    assert min(shared) >= 6
    options = replace(OPTIONS, incomplete="all", scaling="rigid")
    with pytest.raises(InputError, match="at most one is complete"):
        align_collection(
            tmp_path, options=options, fixed={"scan0": np.eye(3)}, jobs=1, progress=False
        )


def test_an_open_shape_of_another_kind_is_a_stranger_and_a_piece_is_none(planted, store, tmp_path):
    rng = np.random.default_rng(4)
    write_mesh(tmp_path / "part.ply", cut(chair(rng), rng.standard_normal(3), 0.4))
    found = align(
        [*sorted(planted[0].glob("*.ply")), tmp_path / "part.ply"],
        store=store,
        incomplete="part,tooth2",
    )
    note = only(found.notes, "resembles-none")
    assert note.shapes == ("part",)
    assert note.values["mismatch"] > 2.0 * note.values["median"]
    assert only(found.notes, "incomplete").shapes == BROKEN
    assert {found.names[one.shape]: one.is_stranger for one in found.incomplete} == {
        "part": True,
        "tooth2": False,
    }
    assert (
        found.confidence[found.names.index("part")]
        <= 0.5
        < found.confidence[found.names.index("tooth2")]
    )
