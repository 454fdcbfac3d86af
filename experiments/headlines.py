"""The figures that matter, read from the tables of the experiments."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple


class Headline(NamedTuple):
    """One figure of one experiment, and where it lies.

    ``says`` holds the value as ``{}``; ``compared_with`` is a goal or another tool's figure, with that of the row
    ``other`` where there is one; ``file`` is the table without ``.csv``, ``row`` what the cells of its row start
    with and ``column`` the value's.
    """

    says: str
    compared_with: str
    experiment: str
    file: str
    row: dict[str, str]
    column: str
    other: dict[str, str] | None = None


HEADLINES = (
    Headline(
        "84 objects of CAPOD, seven classes, three draws of poses: {:.1f} % of the pairs off by more than 30 deg",
        "{:.1f} for Open3D's pairs with spectral synchronization",
        "capod",
        "capod",
        {"class": "all classes", "tool": "collalign", "draws": "21"},
        "gross",
        {"class": "all classes", "tool": "Open3D pairs + spectral"},
    ),
    Headline(
        "116 teeth, left and right mixed, five draws of poses: {:.0f} of all pairs off by more than 30 deg",
        "75 in auto3dgm's published alignment of 89 teeth",
        "teeth_jobs",
        "teeth_jobs",
        {"job": "116 teeth", "tool": "collalign"},
        "gross",
    ),
    Headline(
        "the same: median error {:.1f} deg",
        "11.5 in auto3dgm's published alignment of 89 teeth",
        "teeth_jobs",
        "teeth_jobs",
        {"job": "116 teeth", "tool": "collalign"},
        "median_deg",
    ),
    Headline(
        "the same, from the command to the report: {:.0f} s of CPU time",
        "142 for principal axes, ICP and a spanning tree",
        "teeth_jobs",
        "teeth_jobs",
        {"job": "116 teeth", "tool": "collalign"},
        "processor_s",
    ),
    Headline(
        "20 families of eight strongly deformed teeth: {:.1f} % of the pairs off by more than 30 deg",
        "3.8 for Open3D's pairs with spectral synchronization",
        "deformations",
        "deformations",
        {"kind": "tooth", "tool": "collalign"},
        "gross",
    ),
    Headline(
        "20 people in different postures: {:.1f} % of the pairs off by more than 30 deg",
        "goal: 3 %",
        "bending",
        "bending",
        {"collection": "human"},
        "gross",
    ),
    Headline(
        "20 planes: {:.1f} % of the pairs off by more than 30 deg",
        "goal: 5 %",
        "bending",
        "bending",
        {"collection": "plane"},
        "gross",
    ),
    Headline(
        "poses stated at 95 % or more: {:.1f} % right, with weights fitted without the collection",
        "goal: 99 %",
        "confidence",
        "confidence_goals",
        {"figure": "right among the shapes"},
        "left_out",
    ),
    Headline(
        "runs with a wrong pose and no warning: {:.1f} %",
        "goal: 1 %",
        "confidence",
        "confidence_goals",
        {"figure": "runs with a shape"},
        "value",
    ),
    Headline(
        "teeth classified by their nearest neighbour: {:.0f} % of the genera right",
        "91.9 in the paper",
        "classification",
        "classification",
        {"way": "toolkit, closest points"},
        "genus",
    ),
    Headline(
        "landmarks carried to mouse skulls from one template: {:.2f} mm off",
        "goal: 0.20",
        "landmarks",
        "landmarks",
        {"collection": "mouse", "templates": "1"},
        "carried",
    ),
    Headline(
        "maps of SCAPE's bodies: mean error {:.3f} of the square root of the area",
        "goal: 0.015",
        "maps",
        "maps",
        {"set": "scape", "method": "collalign", "pairs": "6"},
        "direct",
    ),
    Headline(
        "maps from people to armadillos: {:.2f}",
        "goal: 0.12",
        "bodies",
        "bodies",
        {"set": "human and armadillo"},
        "mean",
    ),
    Headline(
        "generated views of objects, 48 degrees apart: {} pairs within 16 degrees",
        "Open3D's FPFH, RANSAC and ICP: {}",
        "scans",
        "scans",
        {"scans": "4 objects", "tool": "collalign"},
        "class_1",
        {"scans": "4 objects", "tool": "Open3D"},
    ),
    Headline(
        "each of 31 mouse skulls as the only template: mean RV {:.4f} of two answers",
        ".944 for ALPACA, .960 for its consensus (published, 62 skulls)",
        "templates",
        "templates",
        {"templates": "31"},
        "rv",
    ),
    Headline(
        "pairs of teeth of which the best pose is proven: {:.0f} of 6670",
        "",
        "proofs",
        "proofs_teeth",
        {"pairs": "6670"},
        "proven",
    ),
)


def write_headlines(results: Path) -> str:
    """Return the table of those figures that were measured, empty without any.

    Parameters
    ----------
    results : Path
        Folder with the tables and sections.
    """
    rows = [line for headline in HEADLINES for line in _lines(headline, results)]
    head = [
        "## The figures that matter",
        "",
        "| measured | compared with | details |",
        "| --- | --- | --- |",
    ]
    return "\n".join([*head, *rows, ""]) if rows else ""


def _lines(headline: Headline, results: Path) -> list[str]:
    section, table = results / f"{headline.experiment}.md", results / f"{headline.file}.csv"
    if not (section.is_file() and table.is_file()):
        return []
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    said = _filled(headline.says, rows, headline.row, headline.column)
    other = headline.compared_with
    if headline.other is not None:
        other = "".join(_filled(headline.compared_with, rows, headline.other, headline.column))
    link = f"[{headline.experiment}](results/{headline.experiment}.md)"
    return [f"| {text} | {other} | {link} |" for text in said]


def _filled(
    words: str, rows: list[dict[str, str]], wanted: dict[str, str], column: str
) -> list[str]:
    """Return the words with the value of the first row whose cells start as wanted; nothing if there is none."""
    found = [
        row for row in rows if all(row[key].startswith(value) for key, value in wanted.items())
    ]
    return [words.format(row[column] if "{}" in words else float(row[column])) for row in found[:1]]
