"""``collalign align --check``: every file is read, and nothing else is done."""

from __future__ import annotations

import numpy as np

from collalign.cli.interruption import INCOMPLETE
from collalign.cli.talk import say, tell, warn
from collalign.engine.jobs.progress import ProgressBar
from collalign.options import AlignOptions
from collalign.stages.shape_stage import common_num_points, excluded_file, odd_sizes
from data_tools.errors import CollectionError, InputError
from data_tools.io.files import readable_name
from data_tools.io.shapes import FolderListing, read_shape
from data_tools.surface.shape import Shape


def check_shapes(listing: FolderListing, options: AlignOptions) -> int:
    """Say of each file what is in it or why it would be left out, and which sizes are odd; return the exit code.

    Raises
    ------
    CollectionError
        If fewer than two files can be read.
    """
    shapes, left_out = dict[str, Shape](), []
    with ProgressBar("files", len(listing.names)) as bar:
        for file, name in zip(listing.files, listing.names, strict=True):
            try:
                shapes[name] = read_shape(file, options.cleaning, name=name)
            except InputError as error:
                left_out.append(excluded_file(file, name, str(error)))
            bar.advance()
    sides = {name: np.ptp(shape.vertices, axis=0) for name, shape in shapes.items()}
    for name, shape in shapes.items():
        triangles = f", {len(shape.faces)} triangles" if shape.is_mesh else ""
        size = " x ".join(f"{side:.4g}" for side in sides[name])
        say(f"{name}: {len(shape.vertices)} points{triangles}, {size}{''.join(f'; {note}' for note in shape.notes)}")
    counts = [len(shape.vertices) for shape in shapes.values()]
    num = common_num_points(counts, options.sampling.num_points)
    notes = [*odd_sizes({name: float(np.linalg.norm(side)) for name, side in sides.items()})]
    if num < options.sampling.num_points:
        notes.append(f"Shapes would be matched at {num} points: most have fewer than {options.sampling.num_points}.")
    if few := [name for name, shape in shapes.items() if len(shape.vertices) < num]:
        notes.append(f"Fewer than {num} points, which a run leaves out: {', '.join(few)}.")
    skipped = [readable_name(path) for path in listing.skipped]
    for note in [*notes, *([f"No shapes: {', '.join(skipped)}"] if skipped else [])]:
        say(f"Note: {note}")
    for item in left_out:
        warn(f"Would be left out: {item.file}: {item.reason}")
    tell(
        shapes=[
            {
                "name": name,
                "points": len(shape.vertices),
                "triangles": len(shape.faces),
                "size": sides[name],
                "notes": shape.notes,
            }
            for name, shape in shapes.items()
        ],
        left_out=[{"file": item.file, "reason": item.reason} for item in left_out],
        skipped=skipped,
        notes=notes,
    )
    if len(shapes) - len(few) < 2:
        raise CollectionError(
            f"{len(shapes) - len(few)} readable shapes, at least two are needed to align a collection"
        )
    say(f"{len(shapes) - len(few)} of {len(listing.names)} files can be aligned.")
    return INCOMPLETE if left_out or few else 0
