"""Which shapes the contact sheet draws, and the colours of their places."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from collalign.output import write
from collalign.output.vertex_maps import PlaceColours
from collalign.output.views import contact_sheet, draw_panels, painted
from data_tools.html_pages import new_figure
from data_tools.io.output_folder import OutputFolder
from data_tools.surface.shape import Shape
from tests.products import vertex_maps_of
from tests.view_problems import bumpy_shapes, view_of


@pytest.mark.parametrize(("most", "drawn"), [(100, [0, 1, 2, 3, 4]), (3, [0, 2, 4])])
def test_all_shapes_are_drawn_or_as_many_as_fit_from_the_first_to_the_last(
    most, drawn, tmp_path, monkeypatch
):
    monkeypatch.setattr(write, "_MAX_TILES", most)
    view = view_of(5)
    with OutputFolder.open(tmp_path, writer="align") as output:
        ((name, sheet),) = write._documents(view, output, None)
    assert name == "sheet"
    assert [shape.name for shape, _, _ in sheet.args[1]] == [view.names[i] for i in drawn]


def test_colours_are_the_places_along_the_axes_of_the_reference():
    corners = np.stack(
        np.meshgrid([0.0, 1.0], [5.0, 7.0], [-2.0, 3.0], indexing="ij"), axis=-1
    ).reshape(-1, 3)
    other = np.array([[0.5, 6.0, 0.5], [np.nan] * 3, [9.0, 9.0, 9.0]])
    sure = np.linspace(0.0, 1.0, 8), np.array([0.9, np.nan, 0.2])
    maps = vertex_maps_of("ab", (corners, other), vertex_confidence=sure)
    colours = PlaceColours(maps)
    of_corners = colours.of_file("a")
    np.testing.assert_allclose(np.unique(of_corners[:-1, :3].round(9)), [0.08, 0.92])
    assert len(np.unique(of_corners[:-1, :3].round(9), axis=0)) == 8
    np.testing.assert_array_equal(colours.of_file("b")[:, 3], [0.9, 0.0, 0.2, 0.0])
    middle, unknown, outside, none = colours.of_file("b")[:, :3]
    np.testing.assert_allclose(middle, 0.5)
    assert set(outside.round(9)) <= {0.08, 0.92}
    for grey in (unknown, none, of_corners[-1, :3], *colours.of_file("c")[:, :3]):
        np.testing.assert_array_equal(grey, 0.6)


def test_the_contact_sheet_shows_every_shape_before_and_after_in_its_own_cell():
    """Two meshes and a cloud of four cells: something is drawn in the six halves of theirs, nothing in the fourth."""
    vertices, faces = bumpy_shapes(1, subdivisions=2)
    tiles = [
        (Shape.from_arrays(vertices[0], own, name=""), np.eye(4), float("nan"))
        for own in (faces, faces, np.empty((0, 3), dtype=int))
    ]
    dark = np.asarray(contact_sheet(tiles)).min(axis=2) < 250
    cells = dark.reshape(2, dark.shape[0] // 2, 4, dark.shape[1] // 4).mean(axis=(1, 3))
    assert cells[0].min() > 0.3, "the share of a cell that a round mesh covers"
    np.testing.assert_array_equal(cells[1] > 0, [True, True, False, False])


def test_a_panel_is_painted_over_those_before_it_and_lies_in_its_place_of_a_figure():
    corners = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]])
    red, blue = (corners, np.array([[1.0, 0.0, 0.0]])), (0.5 * corners, np.array([[0.0, 0.0, 1.0]]))
    pixels = np.asarray(painted([red, blue], (2.0, 1.0), 40.0))
    assert pixels.shape == (40, 80, 3)
    assert pixels[38, 2].tolist() == [0, 0, 255], "the lower left corner, which both cover"
    assert pixels[38, 60].tolist() == [255, 0, 0]
    assert pixels[2, 78].tolist() == [255, 255, 255]
    assert np.asarray(painted([blue, red], (2.0, 1.0), 40.0))[38, 2].tolist() == [255, 0, 0]
    point = (np.array([[1.0, 0.5]]), np.array([[0.0, 0.0, 0.0]]))
    assert np.asarray(painted([point], (2.0, 1.0), 40.0))[20, 40].max() < 100
    figure = new_figure(figsize=(2.0, 1.0), dpi=40)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 2.0), ylim=(0.0, 1.0))
    axes.set_axis_off()
    draw_panels(axes, [red, blue])
    figure.savefig(drawn := BytesIO(), format="png")
    shown = np.asarray(Image.open(drawn).convert("RGB")).astype(int)
    assert np.abs(shown - pixels).mean() < 4.0
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, 2.0), (0.0, 1.0))


@pytest.mark.parametrize("name", ["two\nlines", "\udcff", "\u65e5\u672c", ""])
def test_names_of_any_letters_are_drawn(name):
    vertices, faces = bumpy_shapes(1, subdivisions=1)
    shape = Shape.from_arrays(vertices[0], faces, name=name)
    assert contact_sheet([(shape, np.eye(4), 0.5)]).size == (600, 180)
