"""What the shape stage remembers: results of what was read, and failures that the content causes."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions
from collalign.engine.job import run_task
from collalign.engine.session import Session
from collalign.engine.worker import Call, Task, run_in_process
from collalign.nonrigid.map_options import SurfaceOptions
from collalign.products.shapes import Excluded
from collalign.stages import shape_stage as stage
from collalign.stages.deformation_jobs import prepare_all_detailed
from collalign.stages.evidence.map_surfaces import prepare_surfaces
from collalign.stages.incomplete.posed_points import prepare_points
from collalign.stages.incomplete.scan_pairs import describe_surfaces
from collalign.stages.shape_stage import (
    chirality_of_file,
    common_num_points,
    prepare_shapes,
)
from data_tools.datasets.synthetic_shapes import blob
from data_tools.errors import CollectionError
from data_tools.io.listing import read_folder
from data_tools.io.shapes import read_shape, write_mesh
from data_tools.notes import Note
from data_tools.options import CleaningOptions, EmbeddingOptions, SamplingOptions

OPTIONS = AlignOptions(sampling=SamplingOptions(num_points=12, num_dense_points=0))


def arguments(file):
    groups = {
        "cleaning": OPTIONS.cleaning,
        "sampling": OPTIONS.sampling,
        "embedding": OPTIONS.embedding,
    }
    return {"file": file, "name": file.stem, "digest": None, **groups}


@pytest.fixture
def folder(tmp_path):
    for i in range(3):
        write_mesh(
            tmp_path / "shapes" / f"s{i}.ply", blob(np.random.default_rng(i), num_vertices=60)
        )
    return tmp_path / "shapes"


def prepare(folder, store=None, aligning=OPTIONS, **run):
    options = RunOptions(**{"jobs": 1, "store": store or folder.parent / "store"} | run)
    with Session.open(aligning, options) as session:
        return prepare_shapes(session, read_folder(folder))


def test_columns_change_the_keys_of_tables_alone(folder):
    """So that naming those of new tables computes nothing anew of meshes."""
    np.savetxt(folder / "s3.xyz", np.random.default_rng(3).random((30, 3)))
    listing = read_folder(folder)
    keys = []
    for columns in ("", "x,y,z", "z,y,x"):
        named = replace(OPTIONS, cleaning=CleaningOptions(columns=columns))
        keys.append(
            {name: one.key for name, one in stage.wanted_shapes(listing, named, {})[0].items()}
        )
    for name in ("s0", "s1", "s2"):
        assert len({of[name] for of in keys}) == 1
    assert len({of["s3"] for of in keys}) == 3
    first, second = (
        read_shape(folder / "s3.xyz", CleaningOptions(columns=columns)).vertices
        for columns in ("x,y,z", "z,y,x")
    )
    np.testing.assert_array_equal(first, second[:, ::-1])


def test_too_few_shapes_beside_tables_say_how_to_take_these(folder):
    for name in ("s1", "s2"):
        (folder / f"{name}.ply").unlink()
        np.savetxt(folder / f"{name}.csv", np.random.default_rng(0).random((30, 3)), delimiter=",")
    with pytest.raises(
        CollectionError, match=r"1 readable shapes.* collection; s1\.csv, s2\.csv: tables beside"
    ):
        prepare(folder)


def test_a_file_that_is_edited_between_its_key_and_its_reading_poisons_nothing(folder, monkeypatch):
    edited, original = folder / "s1.ply", (folder / "s1.ply").read_bytes()
    hash_shape = stage.hash_shape

    def hash_and_edit(path):
        digest = hash_shape(path)
        if path == edited:
            write_mesh(path, blob(np.random.default_rng(7), num_vertices=60))
        return digest

    monkeypatch.setattr(stage, "hash_shape", hash_and_edit)
    prepared = prepare(folder)
    assert prepared.excluded == (
        Excluded(file="s1.ply", reason="has changed since the run began; run again"),
    )
    monkeypatch.undo()
    edited.write_bytes(original)
    fresh = prepare(folder)
    assert fresh.names == ("s0", "s1", "s2")
    expected = prepare(folder, folder.parent / "clean")
    for clean, again in zip(expected.samples, fresh.samples, strict=True):
        np.testing.assert_array_equal(clean.positions, again.positions)


def test_failures_of_the_machine_are_tried_again_and_those_of_the_content_are_not(folder):
    (folder / "bad.ply").write_text("ply\nnonsense")
    call = Call(function=partial(run_task, stage.SAMPLING.run, True))
    again = {}
    for token, file in enumerate([*sorted(folder.iterdir()), folder / "missing.ply"]):
        task = Task(token=token, key=file.name, payload=arguments(file))
        outcome = run_in_process(call, task)
        if outcome.failure is not None:
            again[file.name] = outcome.crashed
    assert again == {"bad.ply": False, "missing.ply": True}


#: Every stage that reads files again.
READING_AGAIN = {
    "chirality": stage.measure_surfaces,
    "maps": prepare_surfaces,
    "all vertices": lambda session, shapes: prepare_all_detailed(session, shapes, SurfaceOptions()),
    "incomplete": lambda session, shapes: prepare_points(session, shapes, range(3)),
    "scans": lambda session, shapes: describe_surfaces(
        session, shapes, range(3), 0.1, of_scene=False
    ),
}


@pytest.mark.parametrize("what", ["changed", "vanished", "is the same"])
@pytest.mark.parametrize("again", READING_AGAIN)
def test_a_file_that_is_lost_after_its_first_reading_ends_the_run(folder, again, what):
    options = replace(OPTIONS, group="SO")
    with Session.open(options, RunOptions(jobs=1, store=folder.parent / "store")) as session:
        shapes = prepare_shapes(session, read_folder(folder))
        if what == "changed":
            write_mesh(folder / "s1.ply", blob(np.random.default_rng(7), num_vertices=60))
        elif what == "vanished":
            (folder / "s1.ply").unlink()
        if what == "is the same":
            has_too_few_vertices = again in ("maps", "all vertices")
            assert len(READING_AGAIN[again](session, shapes)) == (0 if has_too_few_vertices else 3)
            return
        with pytest.raises(CollectionError, match=r"s1\.ply: has changed or vanished"):
            READING_AGAIN[again](session, shapes)


def test_point_sets_of_fewer_points_are_matched_at_those_of_the_largest(tmp_path, rng):
    for name, num in (("a", 10), ("b", 9), ("c", 11), ("poor", 4)):
        np.savetxt(tmp_path / f"{name}.xyz", rng.standard_normal((num, 3)))
    shapes = prepare(
        tmp_path, tmp_path / "store", replace(OPTIONS, embedding=EmbeddingOptions(kind="xyz"))
    )
    assert shapes.names == ("a", "b", "c", "poor")
    assert {len(item.vertex_indices) for item in shapes.samples} == {11}
    assert [item.num_places for item in shapes.samples] == [10, 9, 11, 4]
    assert [item.is_poor for item in shapes.samples] == [False, False, False, True]
    assert sorted(np.bincount(shapes.samples[3].vertex_indices)) == [2, 3, 3, 3]
    assert shapes.notes[:2] == (
        Note("fewer-points", values={"num": 11, "asked": 12}),
        Note("few-points", ("a", "b", "poor"), {"num": 11, "counts": (10, 9, 4)}),
    )
    assert not shapes.excluded


def test_the_number_of_points_follows_the_shape_of_most_points():
    assert common_num_points([41] * 9 + [3], 64) == 41
    assert common_num_points([39, 45, 41, 64], 64) == 64
    assert common_num_points([41, 80], 64) == 64
    assert common_num_points([], 64) == 64


def test_the_chirality_of_surfaces_is_found_with_the_samples_where_sides_are_asked_for(folder):
    prepared = prepare(folder)
    file = folder / "s1.ply"
    alone = chirality_of_file(file, "s1", prepared.digests[1], OPTIONS.cleaning)
    for name in ("features", "faces", "areas"):
        np.testing.assert_array_equal(
            getattr(prepared.some([1]).chirality[0], name), getattr(alone, name)
        )
    given = replace(OPTIONS, group="SO")
    assert prepare(folder, folder.parent / "given", given).chirality == (None,) * 3
