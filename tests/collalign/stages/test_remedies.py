"""What is said to help where poses are in doubt, and that nothing is said elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from collalign import AlignOptions, RunOptions
from collalign.engine.session import Session
from collalign.stages.shape_stage import prepare_shapes
from collalign.stages.trust.trust_notes import remedies
from data_tools.datasets.synthetic_shapes import blob
from data_tools.io.objects import list_shapes
from data_tools.io.shapes import write_mesh
from data_tools.notes import Note
from data_tools.options import CleaningOptions, SamplingOptions
from data_tools.rotations import random_rotation
from tests.collalign.stages.test_trust import pairs_at
from tests.pairwise.test_partial_match import cut

NUM = 8
OPTIONS = AlignOptions(group="SO", sampling=SamplingOptions(num_points=16, num_dense_points=0))


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """Says what helps a folder of closed blobs of which the first three are cut open."""
    rng, folder = np.random.default_rng(3), tmp_path_factory.mktemp("blobs")
    for i in range(NUM):
        shape = blob(rng, num_vertices=200)
        write_mesh(folder / f"s{i}.ply", cut(shape, np.eye(3)[0], 0.2) if i < 3 else shape)
    with Session.open(OPTIONS, RunOptions(jobs=1)) as session:
        shapes = prepare_shapes(session, list_shapes(folder))

    def helps(confidence, pairs, options=OPTIONS, strange=()):
        with Session.open(options, RunOptions(jobs=1)) as session:
            return remedies(session, shapes, pairs, confidence, np.isin(np.arange(NUM), strange))

    return helps


def sure(**doubted):
    confidence = np.full(NUM, 0.99)
    for name, chance in doubted.items():
        confidence[int(name[1:])] = chance
    return confidence


def test_two_kinds_are_told_apart_by_pairs_that_agree_and_energies(said):
    kinds = np.arange(NUM) % 2
    pairs = pairs_at(np.tile(np.eye(3), (NUM, 1, 1)))
    rng, mixed = np.random.default_rng(1), []
    for pair in pairs:
        turn = np.eye(3) if kinds[pair.target] == kinds[pair.source] else random_rotation(rng)
        energies = pair.energies * (1.0 if turn[0, 0] == 1.0 else 4.0)
        mixed.append(replace(pair, rotations=pair.rotations @ turn, energies=energies))
    kinds = Note("several-kinds", values={"num": 2, "groups": "s0, s2, s4, s6; s1, s3, s5, s7"})
    assert said(np.full(NUM, 0.9), mixed) == [kinds]
    assert kinds not in said(np.full(NUM, 0.9), pairs)
    assert kinds not in said(sure(s1=0.9), mixed)


def test_nobody_asks_for_incomplete_shapes_who_was_told_of_none(said):
    told, pairs = replace(OPTIONS, incomplete="never"), pairs_at(np.tile(np.eye(3), (NUM, 1, 1)))
    assert said(sure(s1=0.2), pairs, told) == []


def test_a_shape_of_another_kind_is_not_taken_for_incomplete(said):
    found = said(sure(s1=0.3, s2=0.2), pairs_at(np.tile(np.eye(3), (NUM, 1, 1))), strange=[2])
    assert found == [Note("open-borders", ("s1",))]


@pytest.mark.parametrize(("size", "kept"), [(0.5, "auto"), (0.5, "all"), (0.05, "auto")])
def test_components_that_were_left_out_of_doubtful_shapes_are_named(tmp_path, size, kept):
    rng = np.random.default_rng(3)
    for at in range(NUM):
        shape = blob(rng, num_vertices=100)
        handle = size * shape.vertices + np.array([2.0, 0.0, 0.0])
        vertices, faces = (
            np.vstack([shape.vertices, handle]),
            np.vstack([shape.faces, shape.faces + 100]),
        )
        write_mesh(
            tmp_path / f"s{at}.ply",
            replace(shape, vertices=vertices, faces=faces) if at < 3 else shape,
        )
    options = replace(OPTIONS, cleaning=CleaningOptions(components=kept))
    with Session.open(options, RunOptions(jobs=1)) as session:
        shapes = prepare_shapes(session, list_shapes(tmp_path))
        pairs = pairs_at(np.tile(np.eye(3), (NUM, 1, 1)))
        notes = remedies(session, shapes, pairs, sure(s1=0.8, s5=0.8), np.zeros(NUM, dtype=bool))
    expected = [Note("components-left-out", ("s1",))] if kept == "auto" and size == 0.5 else []
    assert [note for note in notes if note.code == "components-left-out"] == expected
