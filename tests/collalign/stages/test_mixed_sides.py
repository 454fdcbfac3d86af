"""Whole runs that decide by themselves whether shapes are mirrored."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions, align_collection
from collalign.confidence.side_model import find_sides
from collalign.engine.session import Session
from collalign.extend import add_to_collection
from collalign.output.write import alignment_record
from collalign.stages import mixed_sides
from collalign.stages.choose_pairs import all_pairs
from collalign.stages.mixed_sides import (
    OF_FEW,
    ONE_OF_TWO,
    chirality_energies,
    group_of_shapes,
    nearest_pairs,
    sides_of_result,
)
from data_tools.datasets.synthetic import bumped, deformed_family, mirrored
from data_tools.datasets.synthetic_shapes import crown, sphere_mesh
from data_tools.embedding.embedding import sample_shape
from data_tools.io.listing import read_folder
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.notes import Note
from data_tools.options import EmbeddingOptions, SamplingOptions
from data_tools.surface.shape import Shape
from tests.commands import read_json, run_command
from tests.notes import codes, only
from tests.products import pair_of

OPTIONS = AlignOptions(
    sampling=SamplingOptions(num_points=24, num_dense_points=0), incomplete="never"
)
ONE = RunOptions(jobs=1)


def lopsided(shape):
    """Shear a shape so that it is far from every mirror symmetry."""
    x, y, z = shape.vertices.T
    sheared = np.column_stack([x + 0.5 * y * z, y, z + 0.4 * x * y])
    return Shape.from_arrays(sheared, shape.faces, name=shape.name)


def crowns(folder, *, num=7, sides=()):
    """Write lopsided crowns, those of ``sides`` mirrored."""
    rng = np.random.default_rng(3)
    family = deformed_family(lopsided(crown(rng, num_vertices=300)), num, rng, rms=0.01)
    for i, shape in enumerate(family):
        write_mesh(folder / f"{shape.name}.ply", mirrored(shape) if i in sides else shape)
    return folder


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    return crowns(tmp_path_factory.mktemp("mixed"), sides=(1, 4))


@pytest.fixture(scope="module")
def one_sided(tmp_path_factory):
    return crowns(tmp_path_factory.mktemp("one_sided"))


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """One store for the runs that may share pairs."""
    return RunOptions(jobs=1, store=tmp_path_factory.mktemp("store") / "store.sqlite")


@pytest.fixture(scope="module")
def aligned_mixed(mixed, store):
    return align_collection(mixed, options=OPTIONS, run=store)


@pytest.fixture(scope="module")
def aligned_one_sided(one_sided, store):
    return align_collection(one_sided, options=OPTIONS, run=store)


#: How the codes of notes about the group begin.
DECISIONS = ("left-right", "sides-", "few-for-sides", "not-reflected")


def without_decision(collection):
    """What two runs share if one was asked for what the other decided."""
    record = alignment_record(collection)
    record["options"].pop("group")
    record["notes"] = [note for note in record["notes"] if not note["code"].startswith(DECISIONS)]
    return record


def test_a_mix_is_noticed_and_aligned_as_if_asked_for(aligned_mixed, mixed, store):
    assert aligned_mixed.group == "O"
    assert aligned_mixed.reflected.tolist() == [i in (1, 4) for i in range(7)]
    other_side = tuple(aligned_mixed.names[i] for i in (1, 4))
    assert Note("left-right-mixed", other_side, {"total": 7}) in aligned_mixed.notes
    asked = align_collection(mixed, options=replace(OPTIONS, group="O"), run=store)
    assert asked.run.num_reused == 7 + 21
    assert without_decision(asked) == without_decision(aligned_mixed)
    record = alignment_record(aligned_mixed)
    assert (record["options"]["group"], record["decided"]["group"]) == ("auto", "O")
    assert (alignment_record(asked)["options"]["group"], asked.group) == ("O", "O")


def test_one_side_comes_out_as_with_rotations_only(aligned_one_sided, one_sided, store):
    found = aligned_one_sided
    assert found.group == "SO"
    assert not found.reflected.any()
    assert "not-reflected" in codes(found.notes)
    asked = align_collection(one_sided, options=replace(OPTIONS, group="SO"), run=store)
    assert without_decision(asked) == without_decision(found)


def test_of_too_few_shapes_surfaces_name_the_sides_and_confidence_is_limited(tmp_path):
    found = align_collection(crowns(tmp_path, num=5, sides=(1,)), options=OPTIONS, run=ONE)
    assert found.group == "O"
    assert found.reflected.tolist() == [i == 1 for i in range(5)]
    assert only(found.notes, "few-for-sides").values["most"] == OF_FEW
    assert "open-borders" not in codes(found.notes)
    assert 0.9 * OF_FEW < found.confidence.max() < OF_FEW


def test_sides_that_one_place_tells_leave_every_pose_in_doubt(tmp_path):
    ball, faces = sphere_mesh(900)
    for i, corner in enumerate(((1, 1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, -1), (1, 1, 1))):
        place = np.array([0.55, 0.55, 0.6]) * corner
        bump = 0.35 * np.exp(-((ball - place) ** 2).sum(axis=1) / 0.125)
        bump += 0.1 * np.exp(-((ball - [0.98, 0.2, 0.1]) ** 2).sum(axis=1) / 0.05)
        shape = Shape.from_arrays(ball * (1.0 + bump)[:, None] * [1.0, 0.8, 0.62], faces)
        noisy = bumped(shape, np.random.default_rng(i), rms=0.005)
        write_mesh(tmp_path / f"{i}.ply", noisy)
    found = align_collection(tmp_path, options=OPTIONS, run=ONE)
    assert only(found.notes, "sides-in-one-place").values["most"] == ONE_OF_TWO
    assert 0.8 * ONE_OF_TWO < found.confidence.max() < ONE_OF_TWO


def test_points_without_triangles_are_not_mirrored_but_in_doubt(tmp_path):
    for i, side in enumerate((1, -1, 1, 1, -1, 1, 1)):
        shape = deformed_family(
            lopsided(crown(num_vertices=300)), 1, np.random.default_rng(i), rms=0.01
        )[0]
        write_mesh(tmp_path / f"crown{i}.ply", Shape.from_arrays(shape.vertices * [side, 1.0, 1.0]))
    found = align_collection(tmp_path, options=OPTIONS, run=ONE)
    assert found.group == "SO"
    unclear = only(found.notes, "not-reflected-unclear")
    assert (unclear.shapes, unclear.values["cause"]) == (("crown1", "crown4"), "no-outer-side")
    assert (found.confidence <= ONE_OF_TWO).tolist() == [i in (1, 4) for i in range(7)]


def test_bilateral_shapes_that_bend_to_either_side_are_not_mirrored(tmp_path):
    rng = np.random.default_rng(0)
    ball, faces = sphere_mesh(500)
    fins = [0.6 * np.exp(-((ball - [-0.8, 0.0, 0.6]) ** 2).sum(axis=1) / 0.08)]
    fins += [0.4 * np.exp(-((ball - [0.5, 0.0, -0.87]) ** 2).sum(axis=1) / 0.06)]
    x, y, z = (ball * (1.0 + sum(fins))[:, None]).T
    for i in range(8):
        bend = 0.5 * rng.choice([-1, 1]) * rng.uniform(0.5, 1.0)
        fish = Shape.from_arrays(np.column_stack([2.0 * x, 0.4 * y + bend * x**2, 0.7 * z]), faces)
        write_mesh(tmp_path / f"fish{i}.ply", bumped(fish, rng, rms=0.003))
    found = align_collection(tmp_path, options=OPTIONS, run=ONE)
    assert found.group == "SO"
    assert found.notes[0].code == "not-reflected-posture"


@pytest.mark.parametrize(
    ("agreement", "group", "limited", "code"),
    [(1e-3, "O", [5], "left-right-mixed"), (2e-4, "SO", [1, 4, 5], "not-reflected-unclear")],
)
def test_shapes_of_an_undecided_side_are_limited_to_one_half(
    monkeypatch, agreement, group, limited, code
):
    sides = np.where(np.isin(np.arange(7), (1, 4)), -1.0, 1.0)
    fits = find_sides(all_pairs(7), np.exp(np.outer(mixed_preferences(sides), [-0.5, 0.5])), 7)
    fits = replace(fits, unsure=np.arange(7) == 5)
    scores = agreement * np.outer(sides, sides)
    scores[6] = scores[:, 6] = 0.0  # surfaces alone do not name the side of this one
    np.fill_diagonal(scores, np.nan)
    monkeypatch.setattr(mixed_sides, "measure_surfaces", lambda session, shapes: ())
    monkeypatch.setattr(mixed_sides, "chirality_scores", lambda measured: 7 / 5 * scores)
    monkeypatch.setattr(
        mixed_sides, "staged_sides", lambda *given: (fits, all_pairs(7), np.ones((21, 2)))
    )
    shapes = SimpleNamespace(names=tuple("abcdefg"), samples=())
    with Session.open(AlignOptions(), ONE) as session:
        found, notes, limits = group_of_shapes(session, shapes, np.zeros((7, 1)), all_pairs(7))
    assert (found, notes[0].code) == (group, code)
    assert limits == dict.fromkeys(limited, ONE_OF_TWO)


def mixed_preferences(sides):
    """Preferences of all pairs, positive for the same side."""
    edges = all_pairs(len(sides))
    return 0.3 * sides[edges[:, 0]] * sides[edges[:, 1]]


def test_the_energies_of_both_kinds_are_told_apart():
    few = sample_shape(
        crown(num_vertices=200),
        SamplingOptions(num_points=8, num_dense_points=0),
        EmbeddingOptions(),
    )
    kinds = [np.diag([1.0, 1.0, -1.0]), np.eye(3), np.diag([-1.0, -1.0, 1.0])]
    assert chirality_energies(pair_of(kinds, [0.1, 0.2, 0.3]), few, few, 1, 4) == (0.2, 0.1)
    alone = chirality_energies(pair_of(kinds[1:], [0.2, 0.3]), few, few, 1, 4)
    assert alone == pytest.approx((0.2, np.nan), nan_ok=True)


def test_dense_samples_tell_the_kinds_apart_where_few_do_not():
    shape, options = (
        lopsided(crown(num_vertices=300)),
        SamplingOptions(num_points=8, num_dense_points=150),
    )
    target, source = (
        sample_shape(one, options, EmbeddingOptions()) for one in (shape, mirrored(shape))
    )
    mirror = np.diag([-1.0, 1.0, 1.0])
    plain, reflected = chirality_energies(
        pair_of([np.eye(3), mirror], [0.2, 0.2]), target, source, 1, 4
    )
    assert reflected < 0.2 * plain
    poses = pair_of(
        [np.eye(3), -np.roll(np.eye(3), 1, axis=0), mirror], [0.2] * 3
    )  # a worse one first of its kind
    assert chirality_energies(poses, target, source, 1, 4)[1] > reflected
    assert chirality_energies(poses, target, source, 2, 4)[1] == reflected


def test_the_pilot_takes_the_nearest_pairs_of_every_shape():
    descriptors = np.array([[0.0], [1.0], [2.1], [3.3], [10.0]])
    near = nearest_pairs(all_pairs(5), descriptors, 1)
    assert near.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert len(nearest_pairs(all_pairs(5), descriptors, 4)) == 10
    kept = nearest_pairs(np.array([[0, 4], [1, 4]]), descriptors, 1)
    assert kept.tolist() == [[0, 4], [1, 4]], "only pairs of the run"


def test_added_shapes_keep_what_was_decided(
    aligned_mixed, aligned_one_sided, mixed, store, tmp_path
):
    new = tmp_path / "new"
    late = read_shape(read_folder(mixed).files[4])
    write_mesh(
        new / "late.ply", Shape.from_arrays(1.1 * late.vertices, late.faces)
    )  # a copy would be skipped
    aligned_mixed.save(tmp_path / "mixed", report=False)
    added = add_to_collection(tmp_path / "mixed", new, run=store)
    assert (added.group, added.options.group) == ("O", "auto")
    assert added.reflected.tolist() == [*aligned_mixed.reflected.tolist(), True]
    aligned_one_sided.save(tmp_path / "one", report=False)
    added = add_to_collection(tmp_path / "one", new, run=store)
    assert (added.group, added.reflected.any()) == ("SO", False)
    assert "added-not-reflected" in codes(added.notes)
    assert any("late" in note.shapes for note in added.notes)


FLIP = np.diag([-1.0, 1.0, 1.0])
#: What a pilot may have said of four shapes.
PILOT = (
    Note("left-right-mixed", ("a",), {"total": 4}),
    Note("sides-by-fit", values={"num_between": 9, "factor": 7.0, "contradicted": 0.5}),
    Note("few-for-sides", values={"most": 0.8}),
    Note("sides-sampled", values={"num": 4, "total": 9}),
)


def pairs_of(energies):
    """Return pairs with a plain and a mirrored candidate of these energies."""
    rotations = np.stack([np.eye(3), FLIP])
    return [
        pair_of(rotations, each, target=target, source=source)
        for (target, source), each in energies.items()
    ]


def test_notes_on_sides_say_what_the_poses_say():
    pairs = pairs_of({(0, 1): (1.0, 2.0), (0, 2): (4.0, 1.0), (1, 3): (1.0, 3.0)})
    reflected = np.array([False, False, True, True])
    mixed, fit, *others = sides_of_result(PILOT, "abcd", pairs, reflected, {})
    assert mixed == Note("left-right-mixed", ("c", "d"), {"total": 4})
    assert fit.values["num_between"] == 2
    assert fit.values["factor"] == pytest.approx(np.sqrt(4.0 / 3.0))
    total = np.log([2.0, 4.0, 3.0]).sum()
    assert fit.values["contradicted"] == pytest.approx(np.log(3.0) / total)
    assert tuple(others) == PILOT[2:]


def test_the_rarer_side_is_named_whichever_is_reflected():
    reflected = np.array([True, False, True, True])
    mixed = sides_of_result(PILOT[:1], "abcd", [], reflected, {})
    assert mixed == (Note("left-right-mixed", ("b",), {"total": 4}),)


def test_no_sides_are_claimed_where_no_shape_is_reflected():
    pairs = pairs_of({(0, 1): (1.0, 2.0), (0, 2): (4.0, 1.0)})
    said = sides_of_result(PILOT, "abcd", pairs, np.zeros(4, dtype=bool), {0: 0.5})
    expected = {"num_better": 1, "num_pairs": 2, "most": 0.5}
    assert said == (Note("sides-not-confirmed", ("a",), expected), PILOT[3])


def test_other_notes_stay_as_they_are():
    notes = (Note("not-reflected-few", values={"num": 3}),)
    assert sides_of_result(notes, "abc", [], np.zeros(3, dtype=bool), {}) == notes


def write_copy(file, copy):
    copy.parent.mkdir(exist_ok=True)
    copy.write_bytes(file.read_bytes())


def test_added_shapes_do_not_hide_what_was_left_out(one_sided, tmp_path):
    folder, out = tmp_path / "folder", tmp_path / "out"
    folder.mkdir()
    for file in read_folder(one_sided).files[:3]:
        write_copy(file, folder / file.name)
    (folder / "broken.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\n")
    (folder / "mended.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 3\n")
    flags = [
        "--sampling.num-points",
        "12",
        "--sampling.num-dense-points",
        "0",
        "--jobs",
        "1",
        "--no-report",
    ]
    run_command("align", folder, "--out", out, *flags, ends=3)
    write_copy(read_folder(one_sided).files[5], tmp_path / "new" / "mended.ply")
    run_command("add", out, tmp_path / "new", "--jobs", "1", "--no-report", ends=3)
    record = read_json(out / "alignment.json")
    assert [item["file"] for item in record["excluded"]] == ["broken.ply"]


def test_a_mirrored_pose_set_by_hand_allows_mirror_images(aligned_mixed, mixed, store):
    fixed = {"crown2": aligned_mixed.rotations[1]}
    found = align_collection(mixed, options=OPTIONS, run=store, fixed=fixed)
    assert found.group == "O"
    assert "reflected-by-given-pose" in codes(found.notes)
    assert np.allclose(found.rotations[1], fixed["crown2"])


def test_a_large_collection_is_decided_on_a_part_of_it(mixed, store, monkeypatch):
    monkeypatch.setattr(
        mixed_sides, "MOST_FOR_SIDES", 5
    )  # of 7, without the third and the fifth, one of the two mirrored
    chosen = align_collection(mixed, options=OPTIONS, run=store)
    assert only(chosen.notes, "sides-sampled").values == {"num": 5, "total": 7}
