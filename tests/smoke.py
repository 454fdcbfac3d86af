"""Aligns three generated shapes with an installed collalign, by function and by command, as a newcomer would first.

Usage: python smoke.py FOLDER, in the environment to be tried; nothing of the checkout is needed.
"""

import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np

import collalign
import pairwise


def try_library(folder):
    """Align arrays, write the result, read it back, match two point sets."""
    points = np.random.default_rng(0).random((40, 3))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    aligned = collalign.align_collection(
        {"still": points, "turned": points @ quarter}, progress=False
    )
    aligned.save(folder / "arrays")
    rotations = collalign.load(folder / "arrays").rotations
    if not np.allclose(rotations[0].T @ rotations[1], quarter, atol=1e-3):
        raise SystemExit(f"the turned copy came back turned by {rotations[0].T @ rotations[1]}")
    if pairwise.match(points[:12], points[:12] @ quarter).energy > 1e-9:
        raise SystemExit("a point set does not match its own copy")


def try_command(folder):
    """Run the README's demonstration, with three shapes, and look for its report."""
    command = Path(sysconfig.get_path("scripts")) / "collalign"
    words = ["demo", "--num-shapes", "3", "--sampling.num-points", "16", "--out", "demo"]
    subprocess.run([command, *words], cwd=folder, check=True, timeout=1200)
    report = (folder / "demo" / "aligned" / "report.html").read_text("utf-8")
    if "<script" not in report or len(report) < 500_000:
        raise SystemExit("the report came without its viewer")


if __name__ == "__main__":
    place = Path(sys.argv[1])
    home = Path(collalign.__file__).parent
    if not home.is_relative_to(sysconfig.get_path("purelib")):
        raise SystemExit(f"collalign was imported from {home}, not from this environment")
    try_library(place)
    try_command(place)
    print(f"collalign {collalign.__version__} works on Python {sys.version.split()[0]}")
