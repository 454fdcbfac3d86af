"""``collalign align --check``: every file is read, and nothing else is done."""

from __future__ import annotations

from typing import Any

import numpy as np

from collalign.cli.interruption import INCOMPLETE
from collalign.cli.talk import say, tell, warn
from collalign.engine.jobs.progress import ProgressBar
from collalign.options import AlignOptions
from collalign.stages.shape_stage import common_num_points, excluded_file, odd_sizes
from data_tools.errors import CollectionError, InputError
from data_tools.io.listing import FolderListing
from data_tools.io.shapes import read_shape
from data_tools.surface.shape import Shape


def check_shapes(listing: FolderListing, options: AlignOptions) -> int:
    """Say of each file what is in it or why it would be left out, and which sizes are odd; return the exit code.

    Raises
    ------
    CollectionError
        If fewer than two files can be read.
    """
    facts, left_out = [], []
    with ProgressBar("files", len(listing.names)) as bar:
        for file, name in zip(listing.files, listing.names, strict=True):
            try:
                facts.append(_facts(name, read_shape(file, options.cleaning, name=name)))
            except InputError as error:
                left_out.append(excluded_file(file, name, str(error)))
            bar.advance()
    for one in facts:
        triangles = f", {one['triangles']} triangles" if one["triangles"] else ""
        size = " x ".join(f"{side:.4g}" for side in one["size"])
        say("; ".join([f"{one['name']}: {one['points']} points{triangles}, {size}", *one["notes"]]))
    num = common_num_points([one["points"] for one in facts], options.sampling.num_points)
    notes = [*odd_sizes({one["name"]: float(np.linalg.norm(one["size"])) for one in facts})]
    if num < options.sampling.num_points:
        notes.append(f"Shapes would be matched at {num} points: most have fewer than {options.sampling.num_points}.")
    if few := [one["name"] for one in facts if one["points"] < num]:
        notes.append(f"Fewer than {num} points, which a run leaves out: {', '.join(few)}.")
    skipped = listing.skipped_names
    for note in [*notes, *([f"No shapes: {', '.join(skipped)}"] if skipped else [])]:
        say(f"Note: {note}")
    for item in left_out:
        warn(f"Would be left out: {item.file}: {item.reason}")
    missing = [{"file": item.file, "reason": item.reason} for item in left_out]
    tell(shapes=facts, left_out=missing, skipped=skipped, notes=notes)
    able = len(facts) - len(few)
    if able < 2:
        raise CollectionError(f"{able} readable shapes, at least two are needed to align a collection")
    say(f"{able} of {len(listing.names)} files can be aligned.")
    return INCOMPLETE if left_out or few else 0


def _facts(name: str, shape: Shape) -> dict[str, Any]:
    """Return what is said of a shape, which need not be kept for it."""
    return {
        "name": name,
        "points": len(shape.vertices),
        "triangles": len(shape.faces),
        "size": np.ptp(shape.vertices, axis=0),
        "notes": shape.notes,
    }
