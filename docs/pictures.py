"""Draws the pictures of the documentation: ``python docs/pictures.py``."""

from __future__ import annotations

import contextlib
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import collalign
import pairwise
from collalign.cli import main as collalign_command
from data_tools.datasets.synthetic import deformed_family, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import voxel_surface
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape

HERE = Path(__file__).resolve().parent
#: Until the report has drawn what has come into view, in ms.
_DRAWING_MS = 2500
#: Keys that turn the skulls of the report from the side to a three-quarter view.
_THREE_QUARTER = 6 * ("ArrowLeft",) + 3 * ("ArrowDown",)


def contact_sheet() -> None:
    """Draw the demonstration's shapes before and after alignment."""
    with tempfile.TemporaryDirectory() as folder:
        collalign_command(["demo", "--out", folder])
        shutil.copy(Path(folder) / "aligned" / "contact_sheet.png", HERE / "contact_sheet.png")


def report(folder: Path = HERE) -> None:
    """Draw the gallery of a report, two rows: generated skulls in random poses, one of which is a braincase only."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as made, sync_playwright() as driver:
        rng = np.random.default_rng(1)
        family = deformed_family(_skull(), 8, rng, rms=0.012)
        family = (*family[:4], _braincase(family[4]), *family[5:])
        write_collection(f"{made}/skulls", planted_collection(family, rng))
        collalign_command(["align", f"{made}/skulls", "--out", f"{made}/out"])
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1000, "height": 780}, color_scheme="light")
        page.goto(Path(made, "out", "report.html").as_uri())
        page.wait_for_selector("html[data-ready]", state="attached")
        page.locator("section", has=page.locator(".tile")).first.scroll_into_view_if_needed()
        page.wait_for_timeout(_DRAWING_MS)
        for key in _THREE_QUARTER:
            page.locator(".tile").first.press(key)
        page.evaluate("document.activeElement.blur()")
        page.wait_for_timeout(_DRAWING_MS)
        page.screenshot(
            path=folder / "report.png", clip={"x": 20, "y": 186, "width": 960, "height": 412}
        )
        browser.close()


#: Ellipsoids that are added to a skull (+1) or cut out of it (-1), in this order: sign, centre, half axes. Those
#: off the middle come in pairs.
_SKULL = (
    (+1, (-0.45, 0.0, 0.1), (0.85, 0.6, 0.55)),
    (+1, (0.55, 0.0, -0.12), (0.95, 0.33, 0.34)),
    (+1, (1.1, 0.0, -0.25), (0.6, 0.24, 0.22)),
    (+1, (-0.4, 0.0, 0.58), (0.7, 0.08, 0.14)),
    (+1, (-1.15, 0.0, 0.2), (0.16, 0.45, 0.2)),
    (-1, (0.42, 0.5, 0.16), (0.34, 0.3, 0.26)),
    (-1, (0.05, 0.62, -0.05), (0.36, 0.26, 0.3)),
    (+1, (0.2, 0.3, 0.36), (0.18, 0.2, 0.1)),
    (+1, (0.62, 0.42, -0.16), (0.2, 0.22, 0.12)),
    (+1, (0.15, 0.66, -0.2), (0.62, 0.08, 0.1)),
    (+1, (-0.42, 0.58, -0.2), (0.22, 0.18, 0.12)),
    (+1, (-0.6, 0.34, -0.42), (0.26, 0.17, 0.2)),
    (+1, (1.4, 0.16, -0.42), (0.1, 0.08, 0.24)),
    (+1, (0.8, 0.23, -0.36), (0.46, 0.09, 0.13)),
    (-1, (0.75, 0.0, -0.55), (0.7, 0.17, 0.2)),
    (-1, (1.66, 0.0, -0.12), (0.2, 0.14, 0.12)),
    (-1, (-1.3, 0.0, -0.3), (0.22, 0.16, 0.16)),
)
#: Length of a voxel of a skull.
_VOXEL = 1 / 30


def _skull() -> Shape:
    """Return a skull with orbits, cheekbones, crest, canines and a hollow palate, forward along x and up along z."""
    lowest, size = np.array([-1.6, -1.0, -0.9]), (108, 61, 54)
    points = lowest + _VOXEL * np.moveaxis(np.indices(size), 0, -1)
    solid = np.zeros(points.shape[:3], dtype=bool)
    for sign, centre, half_axes in _SKULL:
        for side in (1.0, -1.0) if centre[1] else (1.0,):
            inside = (((points - np.array(centre) * [1.0, side, 1.0]) / half_axes) ** 2).sum(
                axis=-1
            ) < 1.0
            solid = solid | inside if sign > 0 else solid & ~inside
    vertices, faces = voxel_surface(solid, resolution=1, smoothing=12)
    return Shape.from_arrays(lowest + _VOXEL * vertices, faces, name="skull")


def _braincase(skull: Shape) -> Shape:
    """Return what is left of a skull whose face is broken off."""
    faces = skull.faces[(skull.vertices[skull.faces][:, :, 0] < 0.1).all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    return Shape.from_arrays(skull.vertices[used], faces.reshape(-1, 3), name=skull.name)


def correction() -> None:
    """Draw a pose replaced by hand in the report of the demonstration: gallery, poses of one shape, decisions."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        collalign_command(["demo", "--out", folder])
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 900, "height": 700}, color_scheme="light")
        page.goto((Path(folder) / "aligned" / "report.html").as_uri())
        page.wait_for_selector("html[data-ready]", state="attached")
        gallery = page.locator("section", has=page.locator(".tile")).first
        gallery.scroll_into_view_if_needed()
        page.wait_for_timeout(_DRAWING_MS)
        gallery.screenshot(path=HERE / "howto" / "correction-gallery.png")
        page.locator(".tile").first.click()
        page.wait_for_timeout(_DRAWING_MS)
        page.get_by_role("button", name="Use this pose").first.click()
        page.locator("dialog[open] figure").nth(5).scroll_into_view_if_needed()
        page.wait_for_timeout(_DRAWING_MS)
        page.locator("dialog[open]").screenshot(path=HERE / "howto" / "correction-poses.png")
        page.get_by_role("button", name="Close").click()
        download = page.get_by_role("button", name="Download decisions")
        download.scroll_into_view_if_needed()
        download.locator("..").screenshot(path=HERE / "howto" / "correction-download.png")
        browser.close()


def two_shapes() -> None:
    """Draw the picture that ``collalign match`` writes of the two chairs of the tutorial."""
    page = (HERE / "tutorials" / "two-shapes.md").read_text("utf-8")
    code = page.partition("```python\n")[2].partition("```")[0]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        exec(code, {})
        collalign_command(["match", "A.ply", "B.ply", "--out", "AB"])
        shutil.copy("AB/match.png", HERE / "tutorials" / "two-shapes.png")


def landmarks() -> None:
    """Landmarks of the tutorial on the mean surface, and a component."""
    from playwright.sync_api import sync_playwright

    page = (HERE / "tutorials" / "landmarks.md").read_text("utf-8")
    blocks = re.findall(r"^```(bash|python)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        sync_playwright() as driver,
    ):
        names: dict[str, object] = {}
        for language, code in blocks:
            if language == "python":
                exec(code, names)
                continue
            for line in code.splitlines():
                collalign_command(line.split()[1:])
        browser = driver.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        shown = browser.new_page(viewport={"width": 700, "height": 1400}, color_scheme="light")
        shown.goto((Path(folder) / "variation" / "variation.html").as_uri())
        shown.wait_for_selector("html[data-ready]", state="attached")
        shown.locator("#components input[type=range]").first.fill("2")
        for part in ("components", "landmarks"):
            section = shown.locator(f"#{part}")
            section.scroll_into_view_if_needed()
            shown.wait_for_timeout(_DRAWING_MS)
            section.screenshot(path=HERE / "tutorials" / f"landmarks-{part}.png")
        browser.close()


def candidates() -> None:
    """Energy of a pair's distinct poses against their angle to the true one, and what is proven."""
    figure = Figure(figsize=(7.5, 3.0), layout="constrained")
    for axes, noise in zip(figure.subplots(1, 2, sharey=True), (0.05, 0.15), strict=True):
        rng = np.random.default_rng(4)
        target, truth, order = rng.uniform(size=(20, 3)), random_rotation(rng), rng.permutation(20)
        source = (target[order] + noise * rng.standard_normal((20, 3))) @ truth
        result = pairwise.match(
            target, source, options=pairwise.MatchOptions(candidate_factor=10.0)
        )
        bound = pairwise.prove(pairwise.Problem.from_user(target, source)).lower_bound
        angles = [rotation_angle_deg(c.R_target_source, truth) for c in result.candidates]
        axes.scatter(angles, [c.energy for c in result.candidates])
        axes.axhline(bound, color="tab:green", label="proven lower bound")
        axes.set_title(f"20 points, noise {noise}", fontsize="small")
        axes.set_xlabel("angle to the true pose (deg)")
        axes.set_ylim(bottom=0.0)
    figure.axes[0].set_ylabel("energy")
    figure.axes[1].legend(fontsize="small")
    figure.savefig(HERE / "candidates.png", dpi=130)


def synchronization() -> None:
    """Median error against the share of wrong pairs, for the eigenprojection and the robust method."""
    shares = np.arange(0.0, 0.61, 0.1)
    figure = Figure(figsize=(4.2, 3.0), layout="constrained")
    axes = figure.subplots()
    for method, style in (("spectral", "o--"), ("robust", "o-")):
        axes.plot(
            shares, [_median_error_deg(share, method) for share in shares], style, label=method
        )
    axes.set_xlabel("share of wrong pairs (half turns)")
    axes.set_ylabel("median error (deg)")
    axes.legend()
    figure.savefig(HERE / "synchronization.png", dpi=130)


def _median_error_deg(share: float, method: str) -> float:
    rng = np.random.default_rng(0)
    num = 40
    true = np.stack([random_rotation(rng) for _ in range(num)])
    edges = [(i, j) for i in range(num) for j in range(i + 1, num)]
    rotations = [np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])]
    measured = []
    for i, j in edges:
        wrong = rotations[rng.integers(3)] if rng.random() < share else np.eye(3)
        noise = random_rotation_near(rng, 0.17)
        measured.append(true[i].T @ noise @ wrong @ true[j])
    found = collalign.synchronize(edges, np.array(measured), method=method).rotations
    errors = [rotation_angle_deg(found[i].T @ found[j], true[i].T @ true[j]) for i, j in edges]
    return float(np.median(errors))


def random_rotation_near(rng: np.random.Generator, spread_rad: float) -> np.ndarray:
    """Draw a rotation by a random vector of the given standard deviation."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(spread_rad / np.sqrt(3.0) * rng.standard_normal(3)).as_matrix()


if __name__ == "__main__":
    contact_sheet()
    report()
    correction()
    two_shapes()
    landmarks()
    candidates()
    synchronization()
