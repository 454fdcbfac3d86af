"""A folder of several kinds: each is aligned by itself, by default, by folders or by labels, and shapes are added."""

from dataclasses import replace

import numpy as np
import pytest

import collalign
from collalign import AlignOptions, RunOptions, align_collection, load
from collalign.output.members import statistics_members
from collalign.products.named_frame import NamedFrame
from data_tools.io.shapes import write_mesh
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation
from experiments.generated.assembled import assembled_objects
from tests.commands import read_json, run_command
from tests.finished_runs import angles_deg
from tests.goldens.inputs import two_kinds
from tests.notes import codes, only

OPTIONS = AlignOptions(
    group="SO", maps="never", sampling=SamplingOptions(num_points=32, num_dense_points=200)
)
ALONE = RunOptions(jobs=1)


@pytest.fixture(scope="module")
def planted():
    return two_kinds(5)


@pytest.fixture(scope="module")
def folder(planted, tmp_path_factory):
    """Eight of them, in a folder of folders, in which files of both kinds have the same names."""
    place = tmp_path_factory.mktemp("mixed") / "objects"
    for at, shape in enumerate(planted.shapes):
        if at % 5 < 4:
            write_mesh(place / ("blobs", "figures")[at // 5] / f"{at % 5}.ply", shape)
    return place


@pytest.fixture(scope="module")
def found(folder):
    return align_collection(folder, recursive=True, options=OPTIONS, run=ALONE, progress=False)


def worst_within_deg(collection, planted):
    """The largest error of the relative rotations of shapes of one kind."""
    named = [name.split("/") for name in collection.names]
    is_figure = np.array([kind == "figures" for kind, _ in named])
    at = 5 * is_figure + [int(number) for _, number in named]
    apart = angles_deg(collection.rotations @ np.swapaxes(planted.rotations[at], 1, 2))
    return apart[is_figure[:, None] == is_figure].max()


def test_kinds_are_found_and_each_is_aligned(found, planted):
    assert [kind.shapes.tolist() for kind in found.kinds] == [[0, 1, 2, 3], [4, 5, 6, 7]]
    assert found.kind_names == ("kind 1",) * 4 + ("kind 2",) * 4
    assert found[5].kind == "kind 2"
    assert worst_within_deg(found, planted) < 15
    assert len(np.unique(found.part_numbers)) == 2
    note = only(found.notes, "kinds-found")
    assert note.values["num"] == 2
    assert 0.5 < float(str(note.values["confidence"])) <= 1.0
    assert {*codes(found.notes)} & {"kinds-posed", "kinds-apart"}
    assert found.kinds[0].frame == 1.0 > found.kinds[1].frame
    assert all({pair.target < 4, pair.source < 4} != {True, False} for pair in found.pairs)


def test_a_loaded_result_knows_its_kinds_and_files(found, tmp_path):
    found.save(tmp_path / "out")
    loaded = load(tmp_path / "out")
    assert loaded.kind_names == found.kind_names
    assert loaded.digests == found.digests
    assert loaded.relative_paths[0] == "blobs/0.ply" == loaded[0].relative_path
    record = read_json(tmp_path / "out" / "alignment.json")
    assert record["shapes"][4]["file"] == "figures/0.ply"
    assert record["shapes"][4]["kind"] == "kind 2"
    assert len(record["shapes"][4]["digest"]) == 40
    assert record["kinds"][1]["shapes"] == [f"figures/{n}" for n in range(4)]
    assert record["kinds"][1]["frame"] < 1.0
    part = loaded.some(np.array([1, 2, 6]))
    assert [kind.shapes.tolist() for kind in part.kinds] == [[0, 1], [2]]


def test_one_may_say_kinds(folder, planted, tmp_path):
    table = tmp_path / "labels.csv"
    rows = [f"{kind}/{n},{kind[:-1]}" for kind in ("blobs", "figures") for n in range(4)]
    table.write_text("name,thing\n" + "\n".join(rows) + "\n")
    words = ["align", folder, "--recursive", "--jobs", "1", "--no-report", "--group", "SO"]
    words += [
        "--maps",
        "never",
        "--sampling.num-points",
        "32",
        "--store",
        tmp_path / "store.sqlite",
    ]
    run_command(*words, "--out", tmp_path / "a", "--kinds-by", "folder")
    run_command(*words, "--out", tmp_path / "b", "--kinds-by", "thing", "--labels", table)
    for out, called in (("a", ("blobs", "figures")), ("b", ("blob", "figure"))):
        result = load(tmp_path / out)
        assert tuple(kind.called for kind in result.kinds) == called
        assert worst_within_deg(result, planted) < 15
        assert codes(result.notes)[0] == "kinds-given"
    said = run_command(*words, "--out", tmp_path / "c", "--kinds-by", "thing", ends=2)
    assert "without --labels" in said.err
    said = run_command(
        *words, "--out", tmp_path / "c", "--kinds-by", "form", "--labels", table, ends=2
    )
    assert "no column 'form'; there are thing" in said.err


def test_a_shape_without_another_of_its_kind_is_alone_and_not_doubtful(planted, tmp_path):
    given = {f"b{n}": planted.shapes[n] for n in range(3)} | {"f": planted.shapes[5]}
    found = align_collection(
        given,
        kinds={"b0": "blob", "b1": "blob", "b2": "blob", "f": "figure"},
        options=OPTIONS,
        run=ALONE,
        progress=False,
    )
    assert found.is_alone.tolist() == [False, False, False, True]
    assert np.isnan(found["f"].confidence)
    assert found["f"].is_alone
    assert not found.is_doubtful[3]
    assert only(found.notes, "kind-alone").shapes == ("f",)
    assert "f" not in [
        name for note in found.notes if note.code == "doubtful" for name in note.shapes
    ]
    assert ("f", "alone") in statistics_members(found).left_out
    found.save(tmp_path / "out")
    record = read_json(tmp_path / "out" / "alignment.json")["shapes"][3]
    assert record["alone"]
    assert record["confidence"] is None
    assert load(tmp_path / "out").is_alone.tolist() == found.is_alone.tolist()


def test_added_shapes_come_to_their_kind_and_nothing_moves(found, planted, tmp_path):
    found.save(tmp_path / "out")
    write_mesh(tmp_path / "new" / "blobs" / "4.ply", planted.shapes[4])
    write_mesh(tmp_path / "new" / "figures" / "4.ply", planted.shapes[9])
    grown = collalign.add_to_collection(
        tmp_path / "out", tmp_path / "new", recursive=True, run=ALONE, progress=False
    )
    np.testing.assert_array_equal(grown.transforms[:8], found.transforms)
    assert grown.kind_names[8:] == ("kind 1", "kind 2")
    assert [kind.frame for kind in grown.kinds] == [kind.frame for kind in found.kinds]
    assert worst_within_deg(grown, planted) < 15


def test_the_folder_of_an_added_shape_says_its_kind_even_where_its_name_is_taken(planted, tmp_path):
    for at, place in ((0, "mixed/blobs/0"), (1, "mixed/blobs/1"), (5, "mixed/figures/0")):
        write_mesh(tmp_path / f"{place}.ply", planted.shapes[at])
    write_mesh(tmp_path / "late" / "blobs" / "0.ply", planted.shapes[4])
    said = {"recursive": True, "kinds": "folder", "run": ALONE, "progress": False}
    first = align_collection(tmp_path / "mixed", options=OPTIONS, **said)
    grown = collalign.add_to_collection(first, tmp_path / "late", **said)
    assert grown.names[3:] == ("late/blobs/0",)
    assert grown.kind_names == ("blobs", "blobs", "figures", "blobs")


def test_the_helper_notices_a_wrong_pose(found, planted):
    wrong = found.transforms.copy()
    wrong[0, :3, :3] = wrong[0, :3, :3] @ np.diag([1.0, -1.0, -1.0])
    assert worst_within_deg(replace(found, transforms=wrong), planted) > 90


def test_up_of_one_shape_is_that_of_its_kind_and_of_kinds_posed_against_it(planted):
    """Three and two blobs that a caller calls two kinds; up is said for a shape of the second one."""
    given = {str(n): planted.shapes[n] for n in range(5)}
    up = random_rotation(np.random.default_rng(4))[2]
    found = align_collection(
        given,
        kinds={str(n): "first" if n < 3 else "second" for n in range(5)},
        options=replace(OPTIONS, reference="3", up=",".join(map(repr, up.tolist()))),
        run=ALONE,
        progress=False,
    )
    assert found.kinds[1].frame == 1.0 > found.kinds[0].frame > 0.0
    assert NamedFrame.of(found.options).up == "z"
    for n in range(5):
        own_up = planted.relative_rotation(n, 3) @ up
        common = found.rotations[found.names.index(str(n))] @ own_up
        away_deg = np.degrees(np.arccos(np.clip(common[2], -1.0, 1.0)))
        assert away_deg < (15 if n > 2 else 20)
    assert "kinds-posed" in codes(found.notes)


def test_objects_of_components_are_read_as_suits_their_kind(planted, tmp_path):
    """Hammers of four pieces among blobs of one: no piece is the object because it is most like a blob."""
    hammers = assembled_objects("hammers", 4, np.random.default_rng(0))
    given = {f"hammer{n}": shape for n, shape in enumerate(hammers)}
    given |= {f"blob{n}": planted.shapes[n] for n in range(3)}
    kinds = {name: name[:-1] for name in given}
    run = RunOptions(jobs=1, store=tmp_path / "store.sqlite")
    alone = align_collection(
        {name: shape for name, shape in given.items() if "hammer" in name},
        options=OPTIONS,
        run=run,
        progress=False,
    )
    mixed = align_collection(given, kinds=kinds, options=OPTIONS, run=run, progress=False)
    assert mixed.assembled == alone.assembled != ()
    assert mixed.kinds[0].cleaning == alone.options.cleaning
