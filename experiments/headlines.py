"""The first page of the results: the figures that matter, read from the tables of the experiments."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple


class Headline(NamedTuple):
    """One figure of one experiment, and where it lies.

    ``says`` holds the value as ``{}``; ``beside`` says what it is compared with, a goal or another tool; ``file`` is
    the table without ``.csv``, ``row`` what the cells of its row start with and ``column`` the value's.
    """

    says: str
    beside: str
    experiment: str
    file: str
    row: dict[str, str]
    column: str


HEADLINES = (
    Headline(
        "116 teeth of both sides in random poses: {:.0f} of all pairs in five draws beyond 30 deg",
        "75 pairs of 89 teeth in auto3dgm's published alignment",
        "teeth_jobs",
        "teeth_jobs",
        {"job": "116 teeth", "tool": "collalign"},
        "gross",
    ),
    Headline(
        "the same, from the command to the report: {:.0f} s of processor time",
        "auto3dgm 249 s by the clock on two cores",
        "teeth_jobs",
        "teeth_jobs",
        {"job": "116 teeth", "tool": "collalign"},
        "processor_s",
    ),
    Headline(
        "20 people who bend: {:.1f} % of the pairs beyond 30 deg",
        "3 % wanted",
        "bending",
        "bending",
        {"collection": "human"},
        "gross",
    ),
    Headline(
        "20 planes: {:.1f} % of the pairs beyond 30 deg",
        "5 % wanted",
        "bending",
        "bending",
        {"collection": "plane"},
        "gross",
    ),
    Headline(
        "of the shapes stated at .95 or more {:.1f} % are right, each collection by weights of the others",
        "98.5 % wanted",
        "confidence",
        "confidence_goals",
        {"figure": "right among the shapes"},
        "left_out",
    ),
    Headline(
        "runs with a wrong shape and no word about it: {:.1f} %",
        "1 % wanted",
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
        "0.20 wanted",
        "landmarks",
        "landmarks",
        {"collection": "mouse", "templates": "1"},
        "carried",
    ),
    Headline(
        "maps of SCAPE's bodies: mean error {:.3f} of the root of the area",
        "0.015 wanted",
        "scape",
        "scape",
        {"set": "scape", "method": "default"},
        "direct",
    ),
    Headline(
        "maps from people to armadillos: {:.2f}",
        "0.15 wanted",
        "shrec07_maps",
        "shrec07_maps",
        {"set": "human and armadillo", "method": "default"},
        "direct",
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
    return (
        "\n".join(
            ["## The figures that matter", "", "| measured | beside | section |", "| --- | --- | --- |", *rows, ""]
        )
        if rows
        else ""
    )


def _lines(headline: Headline, results: Path) -> list[str]:
    section, table = results / f"{headline.experiment}.md", results / f"{headline.file}.csv"
    if not (section.is_file() and table.is_file()):
        return []
    title = section.read_text("utf-8").splitlines()[0].removeprefix("## ")
    anchor = re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")
    with table.open(newline="", encoding="utf-8") as file:
        found = [row for row in csv.DictReader(file) if all(row[k].startswith(v) for k, v in headline.row.items())]
    said = [headline.says.format(float(row[headline.column])) for row in found[:1]]
    return [f"| {text} | {headline.beside} | [{title}](#{anchor}) |" for text in said]
