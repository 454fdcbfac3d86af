"""The page of a transfer in a headless browser: landmarks are flagged, dragged, placed; downloads are read again."""

from dataclasses import replace

import numpy as np
import pytest

from collalign.tools.transfer.command import landmarks_page
from collalign.tools.transfer.result import CARRIED, DOUBTFUL_POSE, PLACED
from data_tools.landmark_files import SemilandmarkRows, read_landmarks
from data_tools.landmark_tables import read_specimens
from data_tools.surface.closest import SurfaceLocator
from tests.browser import Page
from tests.view_problems import transferred_of, view_of

HOSTILE = '=</script><b>x,"y"'
LABELS = ("tip", HOSTILE, "lost", "curve-1")
#: A pixel of the ball of a landmark that was carried over, in pixels of the window.
BALL = """canvas => {
  const { data, width } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  for (let at = 0; at < data.length; at += 4) {
    if (data[at] > 190 && data[at + 1] > 120 && data[at + 1] < 175 && data[at + 2] < 40 && data[at + 3] > 200) {
      return [(at / 4) % width + 1, at / 4 / width + 2].map((value) => (value * canvas.clientWidth) / width);
    }
  }
}"""


def transferred(view):
    points = np.stack([vertices[[5, 40, 80, 90]] for vertices in view.vertices])
    points[:, 2] = np.nan
    status = [(CARRIED, CARRIED, DOUBTFUL_POSE, CARRIED)] * len(view)
    status[0] = (PLACED, PLACED, DOUBTFUL_POSE, PLACED)
    return transferred_of(
        view,
        LABELS,
        points=points,
        radii=np.where(np.isnan(points).any(axis=2), np.nan, 0.05 / view.scales[:, None]),
        status=tuple(status),
        templates=view.names[:1],
        semilandmarks=(SemilandmarkRows("curve", "open curve", (3,)),),
        system="RAS",
    )


@pytest.fixture(scope="module")
def view():
    view = view_of(3)
    return replace(view, names=("a", HOSTILE, "c"))


@pytest.fixture(scope="module")
def written(view, tmp_path_factory):
    folder = tmp_path_factory.mktemp("landmarks")
    page = landmarks_page(view, transferred(view), folder / "my result", folder)
    (folder / "landmarks.html").write_text(page)
    return folder / "landmarks.html"


def saved(page, folder, name):
    with page.expect_download() as started:
        page.get_by_role("button", name=name).click()
    path = folder / started.value.suggested_filename
    started.value.save_as(path)
    return path


def state(page, at):
    return page.locator("dialog tbody tr").nth(at).locator("td").first.text_content()


def opened(page, at):
    page.locator(".card").nth(at).locator("button.name").click()
    canvas = page.locator("dialog canvas[data-drawn]")
    canvas.wait_for()
    page.wait_for_function(
        "[...document.querySelectorAll('dialog canvas')].every(c => c.width > 0)"
    )
    return canvas


def drag(page, canvas, way):
    """Press on a carried landmark, go on, release; return what its row says."""
    x, y = canvas.evaluate(BALL)
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x + way, box["y"] + y + way, steps=3)
    page.mouse.up()


def test_corrected_landmarks_lie_on_the_surface_and_are_templates(browser, written, view, tmp_path):
    with Page(browser, written) as one:
        page = one.page
        assert "0 of 3 specimens have all 3 landmarks" in page.locator(".verdict").inner_text()
        page.locator("select").select_option("name")
        at = page.locator(".card").evaluate_all(
            "cards => cards.findIndex(card => card.dataset.index === '2')"
        )
        canvas = opened(page, at)
        before = [state(page, row) for row in range(3)]
        drag(page, canvas, 0)
        flagged = [state(page, row) for row in range(3)].index("flagged")
        assert before[flagged] == CARRIED
        page.locator("dialog tbody tr").nth(flagged).get_by_role("button").click()
        assert state(page, flagged) == CARRIED
        page.wait_for_timeout(300)
        drag(page, canvas, 25)
        assert [state(page, row) for row in range(3)].count("placed here") == 1
        page.get_by_role("button", name="Place", exact=True).click()
        canvas.click()
        assert state(page, 2) == "placed here"
        marks = read_landmarks(saved(page, tmp_path, "Download .mrk.json"))
        assert (marks.labels, marks.system) == (LABELS[:3], "RAS")
        assert read_landmarks(saved(page, tmp_path, "Download .fcsv")).system == "RAS"
        page.keyboard.press("Escape")
        read = read_specimens(saved(page, tmp_path, "Download templates (CSV)"))
        every = read_specimens(saved(page, tmp_path, "All landmarks (TPS)"))
        page.reload()
        page.wait_for_selector("html[data-ready]", state="attached")
        assert "2 landmarks decided; 2 specimens are" in page.locator(".decisions").inner_text()
        assert "'" in page.locator(".decisions code").inner_text(), (
            "a folder with a blank is quoted"
        )
    assert sorted(read) == ["a", "c"]
    assert read["a"].labels == LABELS[:2]
    assert len(read["c"].labels) == 2, "what was only carried over is no template"
    given = transferred(view).points
    np.testing.assert_allclose(read["a"].points, given[0, :2])
    surface = SurfaceLocator(view.vertices[2], view.faces[2])
    gaps = np.linalg.norm(
        surface.closest(read["c"].points).on(view.vertices[2]) - read["c"].points, axis=1
    )
    assert gaps.max() < 1e-3 / view.scales[2]
    assert np.linalg.norm(read["c"].points[0] - given[2, :2], axis=1).min() > 1e-2 / view.scales[2]
    assert sum(np.isfinite(one.points).all(axis=1).sum() for one in every.values()) == 7
