"""The variation of surfaces: what is computed, what the files say, and the page in a headless browser."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.analysis.procrustes import (
    centroid_sizes,
    generalized_procrustes,
    principal_components,
)
from collalign.output.members import Members
from collalign.tools.correspond import DenseCorrespondence
from collalign.tools.variation.files import write_variation
from collalign.tools.variation.posture import at_mean_posture
from collalign.tools.variation.run import write_surface_variation
from collalign.tools.variation.shape_model import (
    ShapeTestOptions,
    model_terms,
    parse_model,
    read_column,
    settled_columns,
)
from collalign.tools.variation.shape_statistics import shape_tests
from collalign.tools.variation.surface_variation import (
    SurfaceQuality,
    mirror_error,
    shared_error_notes,
    signed_offsets,
    surface_quality,
    surface_symmetry,
    surface_variation,
)
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.errors import InputError, OptionsError
from data_tools.io.shapes import write_ply
from data_tools.notes import Note
from data_tools.rotations import random_rotation
from data_tools.surface.closest import SurfaceLocator
from tests.browser import Page
from tests.commands import read_rows
from tests.notes import codes, only
from tests.view_problems import view_of

ALL = Members(chosen=np.arange(8), left_out=())
LABELS = ("long", "long", "long", "flat", "flat", "flat", "", "")


def stretched(num=8):
    """Return ellipsoids that differ along one axis only, turned, shifted and scaled at random, and their faces."""
    rng = np.random.default_rng(0)
    mean, faces = sphere_mesh(300)
    lengths = np.linspace(1.3, 0.8, num)
    shapes = [
        mean * [1, 1, length] * rng.uniform(1, 5) @ random_rotation(rng).T + rng.random(3)
        for length in lengths
    ]
    return np.array(shapes), faces


@pytest.fixture(scope="module")
def variation():
    shapes, faces = stretched()
    found = surface_variation([f"s{at}" for at in range(len(shapes))], faces, shapes)
    distances = np.linspace(0.1, 0.8, 8)[:, None] * np.ones((8, shapes.shape[1]))
    each = np.percentile(distances, [50, 95, 99], axis=1).T
    quality = SurfaceQuality(
        names=found.names, to_mean=each, to_specimen=each / 2, radii=np.ones(8), distances=distances
    )
    return dataclasses.replace(found, quality=quality)


def test_offsets_are_positive_outside_and_negative_inside():
    mean, faces = sphere_mesh(300)
    np.testing.assert_allclose(signed_offsets(mean, faces, 1.1 * mean), 0.1, atol=5e-3)
    np.testing.assert_allclose(signed_offsets(mean, faces, 0.8 * mean), -0.2, atol=5e-3)
    np.testing.assert_allclose(signed_offsets(mean, faces[:0], 0.8 * mean), 0.2)


def test_a_single_surface_is_refused():
    shapes, faces = stretched()
    with pytest.raises(InputError, match="at least two"):
        surface_variation(["a"], faces, shapes[:1])


def written_to(to, variation, columns, landmarks, **others):
    """Write the variation with the tests of its columns."""
    tests = shape_tests(variation, columns)
    return write_variation(
        variation, to, columns=columns, tests=tests, landmarks=landmarks, who=ALL, **others
    )


@pytest.fixture(scope="module")
def written(variation, tmp_path_factory):
    to = tmp_path_factory.mktemp("variation")
    points = np.vstack([variation.mean[[0, 10]], [[np.nan] * 3]])
    mean, faces = sphere_mesh(300)
    other_side = SurfaceLocator(mean, faces).closest(mean * [-1, 1, 1])
    symmetry = surface_symmetry(stretched()[0], other_side)
    paths = written_to(
        to, variation, {"form": LABELS}, (("a", "b", "c"), points), symmetry=symmetry
    )
    assert paths[0].name == "variation.html"
    return to


def test_tables_and_meshes_are_written(written, variation):
    scores = read_rows(written / "scores.csv")
    np.testing.assert_allclose(
        [float(row["PC1"]) for row in scores],
        variation.components.scores[:, 0] / np.sqrt(len(variation.mean)),
    )
    assert [row["form"] for row in scores] == list(LABELS)
    ranked = read_rows(written / "quality.csv")
    assert [row["name"] for row in ranked] == [f"s{at}" for at in range(7, -1, -1)]
    assert np.isclose(float(ranked[0]["specimen_to_mean_p95"]), 0.8)
    assert {path.name for path in (written / "groups").iterdir()} == {
        "form-flat.ply",
        "form-long.ply",
    }
    assert len(list((written / "specimens").iterdir())) == 8


SIZE = "log(centroid size)"


def test_tests_leave_out_who_has_no_label_or_is_alone_and_say_so(variation):
    tests = shape_tests(variation, {"form": LABELS, "one": ("a", "a", "a", *"bcd", "", "")})
    tables = tests.tables
    groups = [row for row in tables["groups"][1:] if row[0] == "one"]
    assert [row[1:3] for row in groups] == [["(none)", 2], ["a", 3], ["b", 1], ["c", 1], ["d", 1]]
    assert {row[3] for row in groups} == {"not tested"}
    assert [row[:4] for row in tables["pairs"][1:]] == [
        ["form", "flat", "long", "nothing"],
        ["form", "flat", "long", SIZE],
    ]
    models = [row[0] for row in tables["anova"][1:]]
    assert list(dict.fromkeys(models)) == [SIZE, "form", f"{SIZE} + form"]
    assert np.isclose(
        variation.centroid_sizes[0],
        np.linalg.norm(stretched()[0][0] - stretched()[0][0].mean(axis=0)),
    )
    size_and_score = np.array([row[-2:] for row in tables["allometry"][1:]])
    np.testing.assert_allclose(size_and_score[:, 0], np.log(variation.centroid_sizes))
    (alone,) = (
        note
        for note in tests.notes
        if note.code == "groups-of-one" and note.values["column"] == "one"
    )
    assert alone == Note(
        "groups-of-one", ("s3", "s4", "s5"), {"column": "one", "groups": ("b", "c", "d")}
    )


def test_numbers_are_covariates_unless_named_as_factors(variation):
    age = ("1.5", "2", "3", "4", "5", "6", "7", "")
    tests = shape_tests(
        variation, {"age": age, "form": LABELS}, ShapeTestOptions(model="size + form + age")
    )
    rows = {(row[0], row[3]): row for row in tests.tables["anova"][1:]}
    assert [
        rows[model, "age"][4] for model in ("age", f"{SIZE} + age", f"{SIZE} + form + age")
    ] == [1, 1, 1]
    assert tests.tables["anova"][1][0] == f"{SIZE} + form + age", "what was asked for comes first"
    assert rows["age", "total"][2] == 7  # the shape without an age does not count
    assert tests.factors == ("form",)
    assert not [row for row in tests.tables["pairs"][1:] if row[0] == "age"]
    assert only(tests.notes, "model-leaves-out").shapes == ("s6", "s7")
    twos = ("1", "1", "1", "1", "2", "2", "2", "2")
    named = shape_tests(
        variation, {"age": twos}, ShapeTestOptions(factors=("age",), permutations=99, seed=3)
    )
    assert [row[:3] for row in named.tables["pairs"][1:2]] == [["age", "1", "2"]]
    for wrong in (
        {"factors": ("sex",)},
        {"model": "size + sex"},
        {"model": "size +"},
        {"model": "a*b*c"},
    ):
        with pytest.raises(InputError, match=r"factors|model"):
            shape_tests(variation, {"age": twos}, ShapeTestOptions(**wrong))


def test_cells_that_are_no_numbers_are_named(tmp_path):
    view = view_of()  # its files do not exist
    labels = {"age": [*map(str, range(9)), "6O"], "sex": [*"mf"] * 5}
    said = "^age: shape_009 has '6O', not a number. 9 other cells are numbers"
    with pytest.raises(InputError, match=said):
        write_surface_variation(view, tmp_path, labels=labels)
    with pytest.raises(InputError, match=r"^sex: shape_000 has 'm', not a number"):
        write_surface_variation(
            view, tmp_path, labels={"sex": labels["sex"]}, tests={"numbers": ("sex",)}
        )
    settled = settled_columns(ShapeTestOptions(factors=("AGE",)), labels, view.names)
    assert (settled.factors, settled.numbers) == (("age", "sex"), ())
    with pytest.raises(OptionsError, match="'age' cannot be both"):
        ShapeTestOptions(factors=("age",), numbers=("age",))


def test_a_model_of_a_factor_needs_two_groups(variation):
    columns = {"sex": (*"mmmmmmf", ""), "age": ("1", "2", "3", "4", "5", "6", "7", "8")}
    with pytest.raises(
        InputError, match="sex has fewer than two groups of two specimens in sex \\+ age"
    ):
        shape_tests(variation, columns, ShapeTestOptions(model="sex + age"))


def test_models_are_read_and_multiplied():
    assert parse_model("shape ~ size * sex + age", ["sex", "age"]) == (
        ("size",),
        ("sex",),
        ("size", "sex"),
        ("age",),
    )
    sex = read_column("sex", ("f", "m", "f", "m", ""), [*"abcde"], as_factor=True)
    sizes = np.arange(5.0)
    terms, chosen = model_terms([("size",), ("sex",), ("size", "sex")], {"sex": sex}, sizes)
    assert chosen.tolist() == [True] * 4 + [False]
    np.testing.assert_array_equal(terms[f"{SIZE}:sex"], [[0, 0], [0, 1], [2, 0], [0, 3]])


def test_size_is_not_tested_where_a_unit_is_off(variation):
    shapes, faces = stretched()
    shapes[3] *= 1000
    odd = surface_variation(variation.names, faces, shapes)
    tests = shape_tests(odd, {"form": LABELS})
    assert {row[0] for row in tests.tables["anova"][1:]} == {"form"}
    assert {row[3] for row in tests.tables["pairs"][1:]} == {"nothing"}
    assert (tests.notes[0].code, tests.notes[0].shapes) == ("size-not-tested", ("s3",))
    with pytest.raises(InputError, match="another unit"):
        shape_tests(odd, {"form": LABELS}, ShapeTestOptions(model="size + form"))


@pytest.mark.parametrize(
    ("tests", "said"),
    [
        ({"model": "sxe"}, "sxe"),
        ({"factors": ("sxe",)}, "sxe"),
        ({"model": "size + sex"}, "another unit: shape_003"),
    ],
)
def test_tests_that_cannot_be_made_are_refused_before_anything_is_registered(tmp_path, tests, said):
    view = view_of()  # its files do not exist
    marks = np.random.default_rng(3).standard_normal((10, 5, 3))
    marks[3] *= 1000
    view = dataclasses.replace(view, landmarks=marks)
    with pytest.raises(InputError, match=said):
        write_surface_variation(view, tmp_path, labels={"sex": [*"mf"] * 5}, tests=tests)


def test_specimens_are_ranked_by_how_well_they_are_represented(tmp_path):
    mean, faces = sphere_mesh(300)
    dent = np.where(mean[:, :1] > 0.8, 0.8, 1.0)
    surfaces = {"whole": 1.1 * mean, "dented": 1.1 * dent * mean}
    for name, vertices in surfaces.items():
        write_ply(tmp_path / f"{name}.ply", 10 * vertices, faces)
    names, fitted = tuple(surfaces), np.stack([1.1 * mean, 1.1 * mean])
    apart = [np.linalg.norm(vertices - 1.1 * mean, axis=1) for vertices in surfaces.values()]
    dense = DenseCorrespondence(
        names=names,
        faces=faces,
        mean=fitted[0],
        vertices=fitted,
        completed=fitted,
        residual=np.array(apart),
        quality=np.ones((2, len(mean))),
    )
    view = dataclasses.replace(
        view_of(2),
        names=names,
        files=tuple(str(tmp_path / f"{name}.ply") for name in names),
        transforms=np.tile(np.diag([0.1, 0.1, 0.1, 1.0]), (2, 1, 1)),
    )
    found = surface_quality(view, dense)
    assert [row[:2] for row in found.rows] == [[1, "dented"], [2, "whole"]]
    np.testing.assert_allclose(
        found.to_mean[0], 0, atol=1e-5
    )  # coordinates of the file are float32
    np.testing.assert_allclose(found.to_mean[1, 2], 10 * 0.22, rtol=0.02)  # in the unit of the file
    np.testing.assert_allclose(found.to_specimen[1], 10 * np.percentile(apart[1], [50, 95, 99]))
    np.testing.assert_allclose(found.radii, 11, rtol=1e-3)
    np.testing.assert_allclose(
        found.share, np.maximum(found.to_mean, found.to_specimen)[:, 1] / found.radii
    )


def test_posture_is_taken_out_and_shape_and_size_stay():
    rng = np.random.default_rng(3)
    sphere, _ = sphere_mesh(200)
    skull, jaw = sphere * [2.0, 1.0, 1.0], 0.5 * sphere * [1.5, 1.0, 0.3]
    parts = np.repeat([0, 1], len(sphere))
    longer = np.linspace(0.8, 1.2, 6)

    def specimen(length, angle):
        turn = Rotation.from_euler("y", angle).as_matrix()
        return np.vstack([skull, (jaw * [length, 1.0, 1.0]) @ turn.T + [1.0, 0.0, -1.2]])

    angles = rng.permutation(np.linspace(-0.4, 0.4, 6))
    open_jaws = np.stack([3.0 * specimen(*one) for one in zip(longer, angles, strict=True)])
    closed = np.stack([3.0 * specimen(length, 0.0) for length in longer])
    moved = at_mean_posture(open_jaws, parts)
    kept, plain = (
        principal_components(generalized_procrustes(moved)),
        principal_components(open_jaws),
    )
    assert kept.shares[0] > 0.98 > plain.shares[0], "only the length of the jaw is left"
    assert abs(np.corrcoef(kept.scores[:, 0], longer)[0, 1]) > 0.99
    for rows in (parts == 0, parts == 1):
        np.testing.assert_allclose(
            centroid_sizes(moved[:, rows]), centroid_sizes(closed[:, rows]), rtol=1e-6
        )


def test_directional_asymmetry_that_the_mirror_map_explains_is_warned_of():
    shapes, faces = stretched()
    mean, _ = sphere_mesh(300)
    exact = SurfaceLocator(mean, faces).closest(mean * [-1, 1, 1])
    turned = Rotation.from_euler("z", 0.1).as_matrix()
    crooked = SurfaceLocator(mean, faces).closest(mean @ turned.T * [-1, 1, 1] + [0, 0.1, 0.1])
    assert mirror_error(mean, exact) < 0.02 < mirror_error(mean, crooked)
    found = surface_symmetry(shapes, crooked)
    directional = np.sqrt((found.directional**2).sum(axis=1).mean())
    assert codes(shared_error_notes(found, 1.01 * directional)) == ["asymmetry-uncertain"]
    assert shared_error_notes(found, 0.99 * directional) == ()


def test_the_page_works_in_a_browser(browser, written, variation, tmp_path):
    with Page(
        browser, written / "variation.html", viewport={"width": 400, "height": 800}
    ) as opened:
        page, before = opened.page, opened.image("#components canvas")
        page.locator("#components input[type=range]").first.fill("2.5")
        opened.wait_until_changed("#components canvas", before)
        assert page.locator("#morphospace polygon.around").count() == 2
        marks = page.locator("#morphospace .dot polygon:not(.around)").count()
        assert 0 < marks < len(LABELS), "each group has a mark of its own"
        crowded = page.locator("#morphospace .dot.crowded").count()
        page.locator("#morphospace").get_by_label("Names").uncheck()
        assert page.locator("#morphospace .dot.crowded").count() == len(LABELS) > crowded
        page.locator("#morphospace select").nth(0).select_option("1")
        assert "component 2" in page.locator("#morphospace text.title").first.text_content()
        page.locator("#morphospace .dot").nth(5).dispatch_event("click")
        assert "s5" in page.locator("#specimens p.muted").text_content()
        assert page.locator("#landmarks tbody tr").count() == 2
        assert page.locator("#symmetry tbody tr").count() == 4 + 8
        page.locator("#symmetry select").select_option("3")
        assert "s2: asymmetry" in page.locator("#symmetry p[aria-live]").text_content()
        assert "s7, number 1 of 8" in page.locator("#quality p[aria-live]").text_content()
        page.locator("#quality").get_by_role("button", name="s2", exact=True).click()
        assert "s2, number 6 of 8" in page.locator("#quality p[aria-live]").text_content()
        assert "log(centroid size) explains" in page.locator("#statistics p").first.text_content()
        assert page.locator("#statistics table").nth(1).locator("tbody tr").count() == 2
        assert page.locator("#statistics svg .dot").count() == 8
        assert page.locator("#statistics svg line.fitted").count() == 1
        for ending, words in (("SVG", 'paint-order="stroke'), ("PDF", "principal component")):
            with page.expect_download() as started:
                page.locator("#morphospace").get_by_role(
                    "button", name=f"Save chart ({ending})"
                ).click()
            text = Path(started.value.path()).read_text()
            assert words in text
            assert "flat" in text, "the legend goes with the chart"
        starts = [
            int(line[:10])
            for line in text.split("xref\n")[1].splitlines()
            if line.endswith("00000 n ")
        ]
        assert [text[at:].split(" 0 obj")[0] for at in starts] == ["1", "2", "3", "4", "5"]
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
    written_to(tmp_path, variation, {}, ((), np.empty((0, 3))))
    with Page(browser, tmp_path / "variation.html") as plain:
        words = plain.page.locator("#specimens p.muted").text_content()
        assert words[-1].isdigit()  # no labels, and nothing before them
