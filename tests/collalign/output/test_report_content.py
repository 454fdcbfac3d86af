"""What goes into the page, without a browser."""

import base64
import dataclasses
import gzip
import hashlib
import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from collalign.output import report
from collalign.output.members import statistics_members
from collalign.output.report.content import build_content
from collalign.output.report.page import report_pages, shown_part, write_report
from collalign.output.report.payload import MISSING, pack_mesh, quaternions
from collalign.products.shapes import Incomplete
from data_tools.embedding.copies import Copies
from data_tools.notes import Note
from tests.view_problems import view_of


def unpack(fields, text):
    """The reader's side of :func:`pack`."""
    raw, found, at = gzip.decompress(base64.b64decode(text)), {}, 0
    for name, dtype, length in fields:
        end = at + length * np.dtype(dtype).itemsize
        found[name] = np.frombuffer(raw[at:end], dtype=np.dtype(dtype).newbyteorder("<"))
        at = end
    assert at == len(raw)
    return found


def rendered(view, title="Aligned collection"):
    return next(report_pages(view, Path("report.html"), title=title)).text()


def data_of(page):
    found = re.search(
        r'<script type="application/json" id="collalign-data">(.*?)</script>', page, re.DOTALL
    )
    assert found is not None
    return json.loads(found[1])


def test_meshes_are_rounded_to_a_sixteen_bit_grid(rng):
    vertices = 1000 + rng.standard_normal((50, 3)) * [1, 10, 100]
    samples = vertices[:4].copy()
    samples[2] = np.nan
    faces = rng.integers(0, 50, (20, 3))
    info, text = pack_mesh(vertices, faces, samples, np.linspace(0, 1, 50))
    found = unpack(info["fields"], text)
    placed = np.array(info["centre"]) + info["step"] * found["vertices"].reshape(-1, 3)
    assert np.abs(placed - vertices).max() <= 0.5 * info["step"] * (1 + 1e-9)
    assert info["step"] == pytest.approx(np.ptp(vertices, axis=0).max() / 65534)
    np.testing.assert_array_equal(found["faces"].reshape(-1, 3), faces)
    np.testing.assert_array_equal(found["samples"].reshape(-1, 3)[2], [MISSING] * 3)
    assert found["scalars"][[0, -1]].tolist() == [0, 255]


def test_quaternions_carry_reflections():
    R = Rotation.random(5, random_state=0).as_matrix() * np.array([1, -1, 1, -1, 1])[:, None, None]
    turns, mirrored = quaternions(R)
    back = Rotation.from_quat(turns).as_matrix() * np.where(mirrored, -1, 1)[:, None, None]
    np.testing.assert_allclose(back, R, atol=1e-12)
    assert mirrored.tolist() == [0, 1, 0, 1, 0]
    assert quaternions(np.empty((0, 3, 3)))[0].shape == (0, 4)


def test_doubtful_incomplete_and_unaligned_shapes_do_not_count_and_are_named():
    half = Incomplete(shape=4, reason="named", partners=np.array([0]), overlaps=np.ones((1, 2)))
    view = dataclasses.replace(
        view_of(9), part_numbers=np.array([0, 0, 0, 0, 0, 0, 0, 0, 1]), incomplete=(half,)
    )
    who = statistics_members(view)
    assert who.chosen.tolist() == [0, 2, 3, 5, 6, 7]
    reasons = {
        "shape_001": "doubtful",
        "shape_004": "incomplete",
        "shape_008": "other-part",
    }
    assert dict(who.left_out) == reasons
    (note,) = who.notes
    assert (note.shapes, note.values["reasons"]) == (tuple(reasons), tuple(reasons.values()))
    assert [row[0] for row in who.table] == ["name", *reasons]
    assert statistics_members(view, include_doubtful=True).chosen.tolist() == [0, 1, 2, 3, 5, 6, 7]
    doubt, other = view.notes[0], Note("not-reflected-few", values={"num": 8})
    assert who.not_said_by([doubt, other]) == [other]
    with_doubtful = statistics_members(view, include_doubtful=True)
    assert with_doubtful.not_said_by([doubt, other]) == [doubt, other]
    everyone = statistics_members(
        view, include_doubtful=True, include_incomplete=True, one_part=False
    )
    assert (everyone.chosen.tolist(), everyone.notes) == (list(range(9)), ())
    pairs = tuple(
        Copies(names=names, kind="moved")
        for names in (("shape_000", "shape_002"), ("shape_001", "shape_003"))
    )
    assert statistics_members(dataclasses.replace(view, copies=pairs)).copies == pairs[:1]
    unknown = dataclasses.replace(view, confidence=np.full(9, np.nan), incomplete=())
    assert statistics_members(unknown).chosen.tolist() == list(
        range(8)
    )  # a baseline states no confidence
    assert "7 shapes are complete and sure, at least 8 are needed; left out: shape_001" in (
        statistics_members(dataclasses.replace(view, incomplete=())).too_few(8)
    )
    assert not statistics_members(dataclasses.replace(view, incomplete=())).too_few(7)


@pytest.mark.parametrize("num_shapes", [2, 3])
def test_tiny_collections_say_what_they_cannot_show(num_shapes):
    plain = view_of(num_shapes)
    view = dataclasses.replace(
        plain, landmarks=plain.landmarks[:, :2], landmark_names=plain.landmark_names[:2]
    )
    document, _ = build_content(view)
    assert "problem" in document["map"]


def test_pairs_carry_maps_poses_and_words():
    """Every seventh pair is wrong by half a turn; the first is mirrored."""
    view = view_of(6)
    first = dataclasses.replace(view.pairs[0], rotations=-view.pairs[0].rotations)
    view = dataclasses.replace(view, pairs=(first, *view.pairs[1:]))
    document, blobs = build_content(view)
    found = unpack([tuple(field) for field in document["pairFields"]], blobs["pairs"])
    assert found["poseCount"].tolist() == [2] * 15
    assert found["poseCount"].sum() == len(found["poseEnergy"]) == len(found["poseRotation"]) / 4
    maps = found["map"].reshape(15, -1)
    assert maps[3, :3].tolist() == [1, 0, 2]
    assert (maps[0] == -2).all()
    assert document["statuses"][found["status"][-1]] == "Time limit reached."
    assert np.flatnonzero(found["mirrored"]).tolist() == [0]
    turned = np.isin(np.arange(15), [0, 3, 10])
    np.testing.assert_allclose(found["disagreement"], 180 * turned, atol=1e-3)


def test_report_is_the_same_each_time_and_needs_no_network(tmp_path):
    path = write_report(view_of(5), tmp_path / "out")
    assert path == tmp_path / "out" / "report.html"
    page = path.read_text(encoding="utf-8")
    assert page == rendered(view_of(5))
    without_script = page[: page.rindex("<script>")]
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", without_script)
    assert "default-src 'none'" in page
    assert "Permission is hereby granted" in page


def test_names_cannot_become_markup():
    bad = "</script><img src=x onerror=alert(1)>"
    view = dataclasses.replace(
        view_of(3), names=(bad, "a & b", "<!--"), notes=(Note("contradicted-by-hand", (bad,)),)
    )
    page = rendered(view, title=bad)
    assert bad not in page
    assert [shape["name"] for shape in data_of(page)["shapes"]] == [bad, "a & b", "<!--"]


def test_bundle_was_built_from_the_sources_beside_it():
    """After a change in viewer/src run ``npm ci && npm run build`` in viewer/."""
    folder = Path(report.__file__).parent
    digest = hashlib.sha256()
    for file in [
        *sorted((folder / "viewer" / "src").iterdir()),
        folder / "viewer" / "package-lock.json",
    ]:
        digest.update(file.read_bytes())
    assert (
        f"sources {digest.hexdigest()};"
        in (folder / "viewer.min.js").read_text(encoding="utf-8")[:200]
    )


def test_of_a_large_collection_the_doubtful_and_evenly_spaced_shapes_are_shown(monkeypatch):
    view = view_of(12)
    assert shown_part(view) is view
    small_pages(monkeypatch)
    part = shown_part(view)
    doubtful = np.argsort(view.confidence)[:3]
    assert {view.names[i] for i in doubtful} <= set(part.names)
    assert part.names == tuple(sorted(part.names))
    assert part.notes[-1] == Note(
        "shown-in-part", values={"num": 6, "total": 12, "num_doubtful": 3}
    )
    kept = [view.names.index(name) for name in part.names]
    assert np.array_equal(part.transforms, view.transforms[kept])
    whole = {
        (view.names[pair.target], view.names[pair.source]): pair.energies for pair in view.pairs
    }
    assert part.pairs
    assert all(whole[part.names[p.target], part.names[p.source]] is p.energies for p in part.pairs)
    assert len(part.pairs) == sum(a in part.names and b in part.names for a, b in whole)


def small_pages(monkeypatch, most=6):
    monkeypatch.setattr("collalign.output.report.page.MOST_ON_PAGE", most)


def test_every_shape_of_a_large_collection_is_on_one_of_the_pages(tmp_path, monkeypatch):
    small_pages(monkeypatch)
    view = dataclasses.replace(view_of(14), names=("<b>&", *view_of(14).names[1:]))
    report = write_report(view, tmp_path)
    pages = sorted((tmp_path / "report_pages").iterdir())
    assert [path.name for path in pages] == ["page-001.html", "page-002.html", "page-003.html"]
    held = [[shape["name"] for shape in data_of(path.read_text())["shapes"]] for path in pages]
    assert sorted(name for names in held for name in names) == sorted(view.names)
    overview = report.read_text()
    for path, names in zip(pages, held, strict=True):
        for name in names:
            assert f'<a href="report_pages/{path.name}">{html.escape(name)}</a>' in overview
    assert 'href="../report.html">overview</a>' in pages[0].read_text()
    assert 'href="page-003.html">next page</a>' in pages[1].read_text()
    assert 'href="page-001.html">page before</a>' in pages[1].read_text()
    assert "next page" not in pages[2].read_text()
