import numpy as np
import pytest

from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import blob, sphere_mesh
from data_tools.errors import InputError, OptionsError
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.surface import cleaning
from data_tools.surface.cleaning import clean, hold_pieces, piece_signatures, shared_object
from data_tools.surface.shape import Shape
from tests.data_tools.surface.test_joined import boxes
from tests.notes import codes, only


def test_clean_shape_is_returned_as_it_is(rng):
    shape = blob(rng, num_vertices=60)
    assert clean(shape) is shape


def test_everything_is_repaired_and_reported(rng):
    good = blob(rng, num_vertices=60)
    small, small_faces = sphere_mesh(20)
    order = np.array([*range(60), 3])
    vertices = np.concatenate([good.vertices[order], 0.01 * small + 9.0, [[5.0, 5.0, 5.0]]])
    moved = np.where(good.faces == 3, 60, good.faces)
    faces = np.concatenate([good.faces[:40], moved[40:], small_faces + 61, [[0, 0, 1], [4, 5, 5]]])
    cleaned = clean(Shape.from_arrays(vertices, faces, name="torn"))
    np.testing.assert_array_equal(cleaned.vertices, good.vertices)
    assert {tuple(sorted(f)) for f in cleaned.faces} == {tuple(sorted(f)) for f in good.faces}
    np.testing.assert_array_equal(cleaned.source_indices, np.arange(60))
    assert codes(cleaned.notes) == [
        "duplicates-merged",
        "degenerate-dropped",
        "components-kept",
        "unreferenced-dropped",
    ]
    merged, degenerate, components, unreferenced = (note.values for note in cleaned.notes)
    assert [merged["num"], degenerate["num"], components["total"], unreferenced["num"]] == [
        1,
        2,
        2,
        21,
    ]


@pytest.mark.parametrize("factors", [None, [0, 0, 0], [1, 0, 0]])
def test_merging_does_not_depend_on_hashes(factors, rng, monkeypatch):
    if factors is not None:  # hashes that collide
        monkeypatch.setattr(cleaning, "_HASH_FACTORS", np.array(factors, dtype=np.uint64))
    places = np.array([[0.0, 1.0, 2.0], [-0.0, 1.0, 2.0], [0.0, 2.0, 1.0], [1.0, 0.0, 2.0]])
    which = rng.integers(0, 4, 50)
    cleaned = clean(Shape.from_arrays(places[which]))
    first = np.sort([np.flatnonzero(np.maximum(which, 1) == place)[0] for place in (1, 2, 3)])
    np.testing.assert_array_equal(cleaned.source_indices, first)


def test_components_nearly_as_large_as_the_largest_are_kept_with_it():
    ball, faces = sphere_mesh(30)

    def balls(*sizes):
        vertices = np.concatenate([ball * size + 5.0 * i for i, size in enumerate(sizes)])
        return Shape.from_arrays(
            vertices, np.concatenate([faces + 30 * i for i in range(len(sizes))])
        )

    bones = clean(balls(1.0, 0.3, 0.91))  # 83 % of the area
    np.testing.assert_array_equal(bones.source_indices, [*range(30), *range(60, 90)])
    kept = bones.notes[0].values
    assert (kept["kept"], kept["total"], kept["share"]) == (2, 3, pytest.approx(95.3, abs=0.05))
    assert len(clean(balls(0.88, 0.3, 1.0)).vertices) == 30  # 77 %
    both = clean(balls(1.0, 0.95))
    assert len(both.vertices) == 60
    (note,) = both.notes
    assert note.values == {"kept": 2, "total": 2, "dropped": 0, "share": pytest.approx(100.0)}


def test_source_indices_go_through_two_cleanings():
    vertices, faces = sphere_mesh(30)
    apart = Shape.from_arrays(np.concatenate([[[9.0, 9.0, 9.0]], vertices]), faces + 1)
    once = clean(apart)
    np.testing.assert_array_equal(apart.vertices[once.source_indices], once.vertices)
    torn = Shape(
        name="torn", vertices=once.vertices, faces=once.faces[(once.faces != 4).all(axis=1)],
        source_indices=once.source_indices, file_size=once.file_size,
    )  # fmt: skip
    twice = clean(torn)
    assert len(twice.vertices) == 29
    assert once.file_size == twice.file_size == len(apart.vertices)
    np.testing.assert_array_equal(apart.vertices[twice.source_indices], twice.vertices)


def test_mesh_without_area_is_refused_by_name():
    line = Shape.from_arrays([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], name="line")
    with pytest.raises(InputError, match="line: every one of its 1 triangles has zero area"):
        clean(line)


def test_options_check_themselves():
    with pytest.raises(OptionsError, match="merge_vertices"):
        CleaningOptions(merge_vertices=1)


@pytest.mark.parametrize(("share", "assembled"), [(1.0, False), (0.97, False), (0.9, True)])
def test_a_shape_is_assembled_where_it_loses_much_with_smaller_components(share, assembled):
    note = Note(cleaning.COMPONENTS_KEPT, values={"share": 100.0 * share})
    assert cleaning.is_assembled([note]) == assembled
    assert not cleaning.is_assembled([])


def plate(size, num, noise, rng):
    """Return a flat piece with a little relief, as a scanned table."""
    x, y = np.meshgrid(np.linspace(-size, size, num), np.linspace(-size, size, num))
    at = np.arange((num - 1) * num).reshape(num - 1, num)[:, :-1].ravel()
    faces = np.concatenate(
        [np.stack([at, at + 1, at + num], 1), np.stack([at + 1, at + num + 1, at + num], 1)]
    )
    return np.column_stack([x.ravel(), y.ravel(), noise * rng.standard_normal(x.size)]), faces


def together(*pieces):
    starts = np.cumsum([0, *(len(points) for points, _ in pieces)])
    return Shape.from_arrays(
        np.concatenate([points for points, _ in pieces]),
        np.concatenate([faces + start for (_, faces), start in zip(pieces, starts, strict=False)]),
    )


def test_an_object_lies_beside_larger_flat_pieces_and_cubes(rng):
    body = blob(rng, num_vertices=400)
    table, wall = plate(5.0, 30, 0.01, rng), plate(3.0, 20, 0.01, rng)
    upright = (wall[0][:, [0, 2, 1]] + [0.0, 6.0, 3.0], wall[1])
    cube = boxes(((3, 3, 3), (8, 0, 0)))
    scene = together(
        (table[0] - [0, 0, 2], table[1]),
        (body.vertices, body.faces),
        upright,
        (cube.vertices, cube.faces),
    )
    cleaned = clean(scene)
    assert cleaned.area == pytest.approx(body.area)
    share = only(cleaned.notes, "plain-pieces").values["share"]
    assert share == pytest.approx(1.0 - body.area / scene.area, abs=1e-6)
    assert clean(scene, CleaningOptions(components="all")).area == pytest.approx(scene.area)


def bar_beside(body):
    """Return the body with a larger, bent bar beside it."""
    ball, faces = sphere_mesh(500)
    bar = ball * [4.0, 0.9, 0.8]
    bar[:, 2] += 0.1 * bar[:, 0] ** 2
    return together((bar + np.array([0.0, 6.0, 0.0]), faces), (body.vertices, body.faces))


def test_the_object_is_the_piece_that_files_share(rng):
    base = blob(np.random.default_rng(5), num_vertices=400)
    bodies = deformed_family(base, 4, rng, rms=0.02)
    scenes = [bar_beside(bodies[0]), bodies[1], bar_beside(bodies[2]), bodies[3]]
    signatures = [piece_signatures(scene) for scene in scenes]
    assert [len(one) for one in signatures] == [2, 1, 2, 1]
    like = shared_object(signatures)
    assert len(like) == 16
    for scene, body in zip(scenes, bodies, strict=True):
        cleaned = clean(scene, CleaningOptions(like=like))
        assert cleaned.area == pytest.approx(body.area)
    taken = clean(scenes[0], CleaningOptions(like=like))
    assert codes(taken.notes)[:2] == ["shared-piece", "components-kept"]
    assert hold_pieces(clean(scenes[0]).notes)
    assert not hold_pieces(clean(scenes[1]).notes)


def test_nothing_is_shared_where_all_files_hold_several_pieces_or_their_largest_is_alike(rng):
    body = blob(np.random.default_rng(5), num_vertices=400)
    scene = piece_signatures(bar_beside(body))
    assert shared_object([scene, scene, scene]) == ()
    alone, small = piece_signatures(body), blob(np.random.default_rng(6), num_vertices=400)
    beside = together((body.vertices, body.faces), (0.7 * small.vertices + [4, 0, 0], small.faces))
    assert shared_object([piece_signatures(beside), alone, alone]) == ()
    assert shared_object([alone]) == (), "one mesh among clouds"


def test_what_the_object_looks_like_is_sixteen_numbers():
    with pytest.raises(OptionsError, match="like: expected 16 numbers, or none, got 3"):
        CleaningOptions(like=(1.0, 2.0, 3.0))
    assert CleaningOptions(like=[1.0] * 16).like == (1.0,) * 16
