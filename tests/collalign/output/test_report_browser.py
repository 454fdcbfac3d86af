"""The report in a real headless Chromium: it loads, draws, answers to mouse and keyboard, and stays offline."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.output.corrections import fixed_by, read_corrections
from collalign.output.report.content import build_content
from collalign.output.report.page import write_report
from tests.browser import Page, launched
from tests.collalign.output.test_report_incomplete import broken_view
from tests.collalign.output.test_report_places import mapped_view
from tests.products import kind_of
from tests.view_problems import view_of

SILHOUETTE = """canvas => {
  const small = new OffscreenCanvas(32, 32).getContext('2d');
  small.drawImage(canvas, 0, 0, 32, 32);
  return [...small.getImageData(0, 0, 32, 32).data].filter((_, at) => at % 4 === 3).map(alpha => alpha > 128 ? 1 : 0);
}"""
NUM_COLOURS = """canvas => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return new Set([...new Uint32Array(data.buffer)]).size;
}"""
#: Controls that a screen reader could not name.
UNNAMED = """() => [...document.querySelectorAll('button, select, input, a, canvas:not([aria-hidden])')]
  .filter(one => !(one.textContent.trim() || one.getAttribute('aria-label') || one.labels?.length))
  .map(one => one.outerHTML)"""
#: Red + green + blue of a computed colour.
BRIGHTNESS = """([selector, property]) => getComputedStyle(document.querySelector(selector))[property]
  .match(/\\d+/g).slice(0, 3).reduce((sum, value) => sum + Number(value), 0)"""
ALL_DRAWN = (
    "() => [...document.querySelectorAll('.tile canvas')].every(canvas => canvas.dataset.drawn)"
)


@pytest.fixture(scope="module")
def small():
    return view_of(10, num_missing=3)


@pytest.fixture(scope="module")
def small_file(small, tmp_path_factory):
    return write_report(small, tmp_path_factory.mktemp("small"), title="Ten bodies")


@pytest.fixture
def opened(browser, small_file):
    """The report of ten shapes; the test fails if the page complained about anything."""
    with Page(browser, small_file) as page:
        yield page
    assert page.requests == [small_file.as_uri()]


@pytest.fixture(scope="module")
def common(browser, small_file):
    with Page(browser, small_file) as page:
        yield page


@pytest.fixture
def read(common):
    """The same page for all tests that only read and open things: they must leave it as it was."""
    yield common
    common.page.keyboard.press("Escape")
    assert common.page.locator("dialog[open], .decisions:visible").count() == 0


def test_many_shapes_load_draw_and_open_without_a_complaint(browser, tmp_path):
    with Page(browser, write_report(view_of(40), tmp_path)) as page:
        assert page.page.locator(".card").count() == 40
        before, after = page.pixels(".tile canvas", 0), page.pixels(".tile canvas", 1)
        assert 0.1 < before["share"] < 0.9
        assert 0.1 < after["share"] < 0.9
        assert before["mean"][0] < before["mean"][2]
        assert after["mean"][0] > after["mean"][2] + 20
        page.page.wait_for_function(ALL_DRAWN, timeout=300_000)
        page.page.locator(".tile").first.click()
        assert page.page.locator("dialog h2", has_text="shape_001").is_visible()
        page.page.keyboard.press("Escape")
        page.page.locator("#pairs table button").first.click()
        assert page.page.locator("dialog[open] canvas").count() == 3


def test_alignment_is_visible(read):
    read.page.wait_for_function(ALL_DRAWN)
    shapes = np.array(
        read.page.locator(".tile canvas").evaluate_all(f"all => all.map({SILHOUETTE})"), dtype=bool
    )
    before, after = shapes[::2], shapes[1::2]

    def overlap(masks):
        return float(masks.all(axis=0).sum() / masks.any(axis=0).sum())

    assert overlap(after) > 0.6 > 0.5 > overlap(before)


def test_turning_one_shape_turns_all_and_spinning_starts_and_stops(opened):
    others = [opened.image(".tile canvas", at) for at in (1, 2)]
    opened.page.locator(".tile").first.focus()
    opened.page.keyboard.press("ArrowRight")
    opened.wait_until_changed(".tile canvas", others[1], 2)
    assert opened.image(".tile canvas", 1) != others[0]
    box = opened.page.locator(".tile").first.bounding_box()
    turned = opened.image(".tile canvas", 2)
    opened.page.mouse.move(box["x"] + 20, box["y"] + 20)
    opened.page.mouse.down()
    opened.page.mouse.move(box["x"] + 90, box["y"] + 30, steps=4)
    opened.page.mouse.up()
    opened.wait_until_changed(".tile canvas", turned, 2)
    assert opened.page.locator("dialog[open]").count() == 0
    spin = opened.page.locator("#spin")
    before = opened.image(".tile canvas", 0)
    spin.click()
    opened.wait_until_changed(".tile canvas", before)
    spin.click()
    assert spin.get_attribute("aria-pressed") == "false"


def test_gallery_is_ordered_by_doubt_and_searched_by_name(opened):
    names = opened.page.locator(".card .name")
    assert names.first.inner_text() == "shape_001"
    opened.page.get_by_label("Find").fill("_00")
    assert opened.page.locator(".card:visible").count() == 10
    opened.page.get_by_label("Find").fill("007")
    assert opened.page.locator(".card:visible").count() == 1
    opened.page.get_by_label("Find").fill("")
    opened.page.locator("#gallery").get_by_label("Order by").select_option("name")
    assert names.first.inner_text() == "shape_000"


def test_overlay_shows_what_is_chosen(opened):
    overlay = opened.page.locator("#overlay")
    assert overlay.locator(".chip").count() == 8
    before = opened.image("#overlay canvas")
    overlay.get_by_label("Show").select_option("taxon=taxon A")
    assert overlay.locator(".chip").count() == 4
    opened.wait_until_changed("#overlay canvas", before)
    overlay.get_by_role("button", name="Remove shape_003").click()
    assert overlay.locator(".chip").count() == 3
    opened.page.locator(".card", has_text="shape_003").get_by_label("overlay").check()
    assert overlay.locator(".chip").count() == 4
    assert opened.pixels("#overlay canvas")["share"] > 0.05


def test_matrix_opens_the_pair_under_the_mouse_and_under_the_cursor(opened, small):
    matrix = opened.page.locator("canvas.matrix")
    opened.page.locator("#pairs").get_by_label("Order by").select_option("name")
    matrix.scroll_into_view_if_needed()
    box = matrix.bounding_box()
    matrix.click(position={"x": box["width"] * 0.45, "y": box["height"] * 0.25})
    title = opened.page.locator("dialog[open] h2")
    assert title.inner_text() == "shape_002 – shape_004"
    before = opened.image("dialog[open] canvas", 1)
    opened.page.get_by_label("alternative 1").check()
    opened.wait_until_changed("dialog[open] canvas", before, 1)
    pair = next(pair for pair in small.pairs if (pair.target, pair.source) == (2, 4))
    assert f"{pair.energy:.3g}" in opened.page.locator("dialog[open] table").inner_text()
    opened.page.get_by_role("button", name="Close").click()
    matrix.focus()
    opened.page.keyboard.press("ArrowRight")
    assert "shape_002 – shape_005" in opened.page.locator(".cell-text").inner_text()
    opened.page.keyboard.press("Enter")
    assert title.inner_text() == "shape_002 – shape_005"


def test_a_correction_is_chosen_downloaded_and_read(opened, small, tmp_path):
    before = opened.image(".tile canvas", 1)
    opened.page.locator("#confidence").get_by_role("button", name="shape_001").click()
    opened.page.get_by_role("button", name="Use this pose").first.click()
    opened.page.get_by_role("button", name="Close").click()
    opened.wait_until_changed(".tile canvas", before, 1)
    assert "set to pose 1" in opened.page.locator(".card").first.inner_text()
    opened.page.locator(".tile").nth(1).click()
    second = opened.page.locator("dialog[open] h2").inner_text()
    opened.page.get_by_role("button", name="This pose is right").click()
    opened.page.keyboard.press("Escape")
    with opened.page.expect_download() as download:
        opened.page.get_by_role("button", name="Download decisions").click()
    download.value.save_as(tmp_path / "corrections.json")
    found = read_corrections(tmp_path / "corrections.json")
    assert list(found.decisions) == ["shape_001", second]
    np.testing.assert_allclose(
        found.decisions["shape_001"], small.alternatives[1][0].rotation, atol=1e-12
    )
    fixed, kept = fixed_by([found], small.names)
    assert set(fixed) | set(kept) == set(small.names)
    # with place and size, so that it does not move at all
    np.testing.assert_allclose(kept["shape_005"], small.transforms[5], rtol=1e-12, atol=1e-12)
    opened.page.get_by_role("button", name="Take back the decision on shape_001").click()
    assert opened.page.get_by_text("1 decision", exact=True).is_visible()


def test_a_pose_set_by_hand_is_marked_and_can_be_taken_back(browser, small, tmp_path):
    by_hand = dataclasses.replace(small, by_hand={"shape_004": 0.2, "shape_005": 0.99})
    file = write_report(by_hand, tmp_path, title="Ten bodies")
    with Page(browser, file) as opened:
        card = opened.page.locator('.card[data-name="shape_004"]')
        assert "set by hand" in card.inner_text()
        assert "the evidence alone gives 20 %" in card.inner_text()
        assert "evidence" not in opened.page.locator('.card[data-name="shape_005"]').inner_text()
        assert "2 of them set by hand" in opened.page.locator(".verdict").inner_text()
        assert opened.page.get_by_text("2 decisions", exact=True).is_visible()
        opened.page.get_by_role("button", name="Take back the decision on shape_004").click()
        assert "decision taken back" in card.inner_text()
        with opened.page.expect_download() as download:
            opened.page.get_by_role("button", name="Download decisions").click()
        download.value.save_as(tmp_path / "corrections.json")
    found = read_corrections(tmp_path / "corrections.json")
    assert list(found.decisions) == ["shape_005"]
    assert "shape_004" not in found.frame


def test_map_is_walked_by_keys_and_coloured_by_labels(read):
    points = read.page.locator("#map g.dot")
    assert points.count() == 9  # shape_001 is in doubt and stays out of statistics
    assert (
        points.evaluate_all("all => all.filter(one => one.getAttribute('tabindex') === '0').length")
        == 1
    )
    assert points.first.locator("circle").get_attribute("fill") != points.nth(1).locator(
        "circle"
    ).get_attribute("fill")
    points.first.focus()
    reached = set()
    for key in ("ArrowRight", "ArrowLeft", "ArrowUp", "ArrowDown"):
        read.page.keyboard.press(key)
        reached.add(read.page.evaluate("document.activeElement.getAttribute('aria-label')"))
    assert len(reached) > 1
    name = read.page.evaluate("document.activeElement.getAttribute('aria-label')").split(",")[0]
    read.page.keyboard.press("Enter")
    assert read.page.locator("dialog[open] h2").inner_text() == name
    read.page.keyboard.press("Escape")
    assert "principal coordinate 1" in read.page.locator("#map svg").text_content()


def test_every_part_holds_what_it_should_and_controls_have_names(read):
    text = {
        part: read.page.locator(f"#{part}").text_content()
        for part in ("excluded", "run", "cycles", "tree", "confidence")
    }
    assert "folder/broken.ply" in text["excluded"]
    assert "export it again" in text["excluded"]
    assert all(word in text["run"] for word in ("sampling.num_points", "numpy", "run.json"))
    assert "Going around 400 cycles" in text["cycles"]
    assert read.page.locator("#cycles rect").count() == 36
    assert read.page.locator("#tree text").count() == 9
    assert (
        read.page.locator("#map a").count() == 0
    )  # the page of collalign variation may not be there
    assert "variation/variation.html" in read.page.locator("#map").text_content()
    first = read.page.locator("#confidence tbody tr").first.inner_text()
    assert first.startswith("shape_001")
    assert "21 %" in first
    assert read.page.evaluate(UNNAMED) == []
    assert read.page.locator("h1").inner_text() == "Ten bodies"
    assert read.page.locator("section[aria-labelledby] h2").count() == 9
    assert read.page.locator("details:not([open]) > summary h2").count() == 3


def test_the_first_line_is_a_verdict_whose_names_open(opened):
    verdict = opened.page.locator(".verdict")
    assert verdict.inner_text() == "9 of 10 poses are sure. Look at: shape_001. 1 file left out."
    verdict.get_by_role("button", name="shape_001").click()
    assert opened.page.locator("dialog[open] h2").inner_text() == "shape_001"
    opened.page.keyboard.press("Escape")
    verdict.get_by_role("link").click()
    assert opened.page.locator("#excluded").is_visible()
    opened.page.get_by_role("link", name="Tree").click()
    assert opened.page.locator("#tree svg").is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_sticks_out_and_text_can_be_read(browser, small_file, scheme):
    with Page(browser, small_file, color_scheme=scheme) as page:
        for width in (360, 900, 1600):
            page.page.set_viewport_size({"width": width, "height": 700})
            assert page.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        text, back = (
            page.page.evaluate(BRIGHTNESS, ["body", what]) for what in ("color", "backgroundColor")
        )
        assert (text > back + 300) == (scheme == "dark")
        page.page.locator("#theme").click()
        assert page.page.evaluate(BRIGHTNESS, ["body", "backgroundColor"]) > 600
        page.page.locator("#theme").click()
        assert page.page.evaluate(BRIGHTNESS, ["body", "backgroundColor"]) < 200


def test_printing_finds_every_shape_drawn(opened, tmp_path):
    opened.page.wait_for_function(ALL_DRAWN)
    opened.page.emulate_media(media="print", color_scheme="dark")
    assert not opened.page.locator("nav").is_visible()
    assert (
        opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
        == "rgb(255, 255, 255)"
    )
    pdf = opened.page.pdf(path=tmp_path / "report.pdf")
    assert len(pdf) > 100_000


def test_page_without_webgl_keeps_tables_and_charts(driver, small_file):
    chromium = launched(driver, "--disable-3d-apis")
    with Page(chromium, small_file) as page:
        assert "no WebGL" in page.page.get_by_role("alert").inner_text()
        assert page.page.locator("#map g.dot").count() == 9
        page.page.locator(".tile").first.click()
        assert page.page.locator("dialog[open] table").is_visible()
        page.problems = [problem for problem in page.problems if "WebGL" not in problem]
    chromium.close()


def test_hostile_names_stay_text_and_clouds_are_drawn(browser, tmp_path):
    bad = "</script><img src=x onerror=\"document.title='owned'\">"
    clouds = dataclasses.replace(view_of(3), faces=(np.empty((0, 3), dtype=np.int64),) * 3)
    view = dataclasses.replace(
        clouds, names=(bad, "<b>b</b>", "c"), labels={"<i>kind</i>": ("<u>", "v", "")}
    )
    with Page(browser, write_report(view, tmp_path, title="safe")) as page:
        assert page.page.title() == "safe"
        assert page.page.locator("main img, main b, main i, main u").count() == 0
        assert bad in page.page.locator("#gallery").inner_text()
        assert page.pixels(".tile canvas", 1)["share"] > 0.01


def test_a_page_that_was_cut_short_says_so(browser, small_file, tmp_path):
    text = small_file.read_text(encoding="utf-8").replace('id="pairs">', 'id="pairs">!')
    (tmp_path / "cut.html").write_text(text, encoding="utf-8")
    context = browser.new_context()
    page = context.new_page()
    page.goto((tmp_path / "cut.html").as_uri())
    assert "could not be opened" in page.get_by_role("alert").inner_text()
    context.close()


def test_corresponding_points_carry_one_colour_on_all_shapes(browser, small_file):
    with Page(browser, small_file, device_scale_factor=1) as opened:
        before, plain = (
            opened.image(".tile canvas", 1),
            opened.canvas(".tile canvas", 1).evaluate(NUM_COLOURS),
        )
        opened.page.locator("#gallery").get_by_label("corresponding points").check()
        opened.wait_until_changed(".tile canvas", before, 1)
        assert opened.canvas(".tile canvas", 1).evaluate(NUM_COLOURS) > plain + 100


def test_a_shape_alone_of_its_kind_is_not_doubtful(browser, tmp_path):
    """It comes last and has no confidence; those of its part that are sure are shown over each other."""
    view, every = view_of(6), np.arange(6)
    confidence = view.confidence.copy()
    confidence[4] = 0.0
    kinds = kind_of("kind 0", every[every != 4]), kind_of("kind 1", every[4:5])
    view = dataclasses.replace(
        view, confidence=confidence, kinds=kinds, part_numbers=1 * (every == 4)
    )
    with Page(browser, write_report(view, tmp_path)) as page:
        assert page.page.locator(".verdict").inner_text().startswith("4 of 5 poses are sure.")
        cards = page.page.locator(".card")
        assert "doubtful" in cards.first.inner_text()
        last = cards.last.inner_text()
        assert "alone of its kind" in last
        assert "%" not in last
        cards.last.locator(".tile").click()
        said = page.page.locator("dialog[open]").inner_text()
        assert "Alone of its kind" in said
        assert "no other shape of its kind" in said
        page.page.keyboard.press("Escape")
        assert "shape_004" not in page.page.locator("#overlay").inner_text()


def test_chances_of_a_shape_add_up(read):
    """The doubtful shape is right with chance 21 %; its other pose, of log-odds 0.7, with 0.21 exp(-0.7) = 10 %."""
    read.page.locator("#confidence").get_by_role("button", name="shape_001").click()
    text = read.page.locator("dialog[open]").inner_text()
    assert "present pose: chance about 21 %" in text
    assert "pose 1: rotated by 180.0°, chance about 10 %" in text
    assert "There is a 68 % chance that none of the poses shown is right" in text
    assert "log-odds" not in text


def test_decisions_survive_a_reload_and_belong_to_one_result(browser, tmp_path):
    with Page(browser, write_report(view_of(4), tmp_path / "one.html")) as page:
        page.page.locator("#confidence").get_by_role("button", name="shape_001").click()
        page.page.get_by_role("button", name="Use this pose").first.click()
        page.page.keyboard.press("Escape")
        page.reload()
        assert "set to pose 1" in page.page.locator(".decisions").inner_text()
        assert "set to pose 1" in page.page.locator(".card").first.inner_text()
        page.page.goto(write_report(view_of(4, seed=1), tmp_path / "two.html").as_uri())
        page.ready()
        assert not page.page.locator(".decisions").is_visible()


def test_decisions_survive_a_reload_where_files_get_no_storage(browser, tmp_path):
    with Page(browser, write_report(view_of(4), tmp_path)) as page:
        page.context.add_init_script(
            "Object.defineProperty(window, 'localStorage', { get() { throw new Error('no'); } })"
        )
        page.reload()
        page.page.locator("#confidence").get_by_role("button", name="shape_001").click()
        page.page.get_by_role("button", name="This pose is right").click()
        page.page.keyboard.press("Escape")
        assert "keeps nothing" in page.page.locator(".decisions").inner_text()
        page.page.on("dialog", lambda dialog: dialog.accept())
        page.reload()
        assert "pose confirmed" in page.page.locator(".decisions").inner_text()


def test_a_shape_is_turned_by_hand(opened, small, tmp_path):
    """Three steps of 7.5 degrees to the right turn the shape about the upright axis of the screen."""
    opened.page.locator("#confidence").get_by_role("button", name="shape_001").click()
    figure = opened.page.locator("dialog[open] figure", has_text="rotate the shape by hand")
    figure.locator("canvas").focus()
    for _ in range(3):
        opened.page.keyboard.press("ArrowRight")
    figure.get_by_role("button", name="Use this pose").click()
    opened.page.keyboard.press("Escape")
    assert "rotated by hand by 22.5°" in opened.page.locator(".decisions").inner_text()
    with opened.page.expect_download() as download:
        opened.page.get_by_role("button", name="Download decisions").click()
    download.value.save_as(tmp_path / "corrections.json")
    (rotation,) = read_corrections(tmp_path / "corrections.json").decisions.values()
    view = np.array(build_content(small)[0]["camera"]["R"])
    turn = view.T @ Rotation.from_euler("y", 22.5, degrees=True).as_matrix() @ view
    np.testing.assert_allclose(rotation, turn @ small.rotations[1], atol=1e-9)


def test_incomplete_shapes_have_a_section_of_their_own(browser, tmp_path):
    with Page(browser, write_report(broken_view(), tmp_path)) as page:
        section = page.page.locator("#incomplete")
        assert section.locator("canvas").count() == 1
        assert page.pixels("#incomplete canvas", 0)["share"] > 0.05
        assert "Covers 70 %" in section.inner_text()
        section.locator("summary").click()
        assert section.locator("tbody tr").count() == 3
        section.locator("tbody button").first.click()
        assert "70 % has a counterpart on" in page.page.locator("dialog[open]").inner_text()


def test_incomplete_clouds_are_coloured_as_surfaces_are(browser, tmp_path):
    """All of this one has a counterpart: yellow, in which there is hardly any blue, and not the colour of bones."""
    view = broken_view()
    clouds = dataclasses.replace(view, faces=(np.empty((0, 3), dtype=np.int64),) * len(view))
    for shown, folder in ((view, "surfaces"), (clouds, "clouds")):
        with Page(browser, write_report(shown, tmp_path / folder)) as page:
            red, _, blue = page.pixels("#incomplete canvas", 0)["mean"]
            assert blue < 0.45 * red


def test_maps_of_vertices_have_a_section_where_there_are_any(browser, tmp_path):
    with Page(browser, write_report(mapped_view(), tmp_path / "mapped")) as page:
        section = page.page.locator("#places")
        assert section.locator("canvas").count() == 6
        assert page.pixels("#places canvas", 0)["share"] > 0.05
        assert page.pixels("#places canvas", 5)["share"] > 0.05
        assert "No maps: " in section.inner_text()
        assert "20 %" in section.locator("figcaption").last.inner_text()
        section.locator("button").first.click()
        assert page.page.locator("dialog[open]").count() == 1
    with Page(browser, write_report(view_of(4), tmp_path / "plain")) as plain:
        assert plain.page.locator("#places").count() == 0
