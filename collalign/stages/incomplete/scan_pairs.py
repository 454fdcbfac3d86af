"""Describes scans in cells of one size and matches every two by what they share, and keeps each result."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from collalign.engine.job import Job, Results, Wanted
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from collalign.stages.shape_stage import compute_surfaces
from data_tools.embedding.embedding import Samples
from data_tools.embedding.surface_points import surface_cells
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.local_surface import PART_CELL, LocalSurface
from data_tools.options import CleaningOptions
from data_tools.surface.outliers import FEWEST_OF_SCAN, without_outliers
from pairwise.features.overlap import LocalPoses, match_overlapping

#: Cells are powers of two to this share, so that a shape more does not change that of all others.
_STEPS_AN_OCTAVE = 4
#: Points that a scan is described by, at most. A scan of the median size has some 2000, so that this one is nearly
#: four times as large. The table of the descriptors of two such takes 3.6 GB.
MOST_DESCRIBED = 30_000
#: Poses that a pair keeps.
NUM_CANDIDATES = 6


def side_known(shapes: Shapes, scan: int) -> bool:
    """Return whether normals of a scan are on the outer side; those of a cloud may be on either."""
    return shapes.samples[scan].rim != "unknown"


def describe_file(
    path: Origin, name: str, digest: str, cleaning: CleaningOptions, cell: float, *, of_scene: bool
) -> LocalSurface:
    """Read one surface and describe its neighbourhoods, unless it has changed since its digest was taken.

    Raises
    ------
    InputError
        If the surface has too few points.
    """
    shape = read_shape(path, cleaning, name=name, digest=digest)
    if cleaning.components != "all" and not shape.is_mesh:
        shape = without_outliers(shape, fewest_points=FEWEST_OF_SCAN)
    found = surface_cells(shape, cell, of_scene=of_scene)
    if found is None:
        raise InputError(f"too few points to describe neighbourhoods of {cell:.3g}")
    return found


def overlap_pair(
    target: LocalSurface, source: LocalSurface, group: str, turned: tuple[bool, bool]
) -> LocalPoses:
    """Return the poses on which two surfaces share most, either one from behind if turned; runs inside a worker."""
    ends = (
        end.seen_from_behind() if is_turned else end
        for end, is_turned in zip((target, source), turned, strict=True)
    )
    return match_overlapping(*ends, group=group, num_candidates=NUM_CANDIDATES)


#: Describes a surface. The version changes whenever the same file and cell would give another one.
DESCRIBING = Job(kind="surfaces", version="local-8", run=describe_file, reader=LocalSurface)
#: Matches a pair by what both share. The version changes whenever the same surfaces would give other poses.
OVERLAPPING = Job(kind="evidence", version="overlap-7", run=overlap_pair, reader=LocalPoses)


def common_cell(samples: Sequence[Samples]) -> float:
    """Return the distance of points at which shapes are described, in the units of the files."""
    radii = [item.scale * np.sqrt((item.positions**2).sum(axis=1).mean()) for item in samples]
    octaves = np.log2(PART_CELL * float(np.median(radii)))
    return float(2.0 ** (np.round(_STEPS_AN_OCTAVE * octaves) / _STEPS_AN_OCTAVE))


def describe_surfaces(
    session: AlignSession, shapes: Shapes, chosen: Sequence[int], cell: float, *, of_scene: bool
) -> Results[int, LocalSurface]:
    """Return the described surfaces of some shapes, by position; shapes of too few points are left out."""
    wanted = {}
    for i in chosen:
        arguments = {
            "path": shapes.files[i],
            "name": shapes.names[i],
            "digest": shapes.digests[i],
            "cleaning": shapes.cleaning[i].again,
            "cell": cell,
            "of_scene": of_scene,
        }
        key = DESCRIBING.key({"cell": cell, "of_scene": of_scene}, shapes.keys[i])
        wanted[i] = Wanted(key=key, label=shapes.names[i], arguments=arguments)
    return compute_surfaces(DESCRIBING, session, shapes, wanted)


def describe_scans(
    session: AlignSession, shapes: Shapes, cell: float, *, of_scene: bool
) -> Results[int, LocalSurface]:
    """Return the described surfaces of all shapes that may overlap, by position.

    Those of too few points, and those that are far larger than most, are left out.
    """
    found = describe_surfaces(session, shapes, range(len(shapes.names)), cell, of_scene=of_scene)
    for i, num in [(i, len(surface.points)) for i, surface in found.items()]:
        if num > MOST_DESCRIBED:
            found.failures[i] = (
                f"far larger than most scans, with {num} points {cell:.3g} apart, more than {MOST_DESCRIBED}; are "
                "all files in the same unit?"
            )
    return found


def overlap_pairs(
    session: AlignSession,
    shapes: Shapes,
    surfaces: Results[int, LocalSurface],
    turned: frozenset[int],
) -> dict[tuple[int, int], LocalPoses]:
    """Return what every two surfaces share, by target and source; those that are turned as seen from behind."""
    group, wanted = session.options.group, {}
    for i, j in itertools.combinations(sorted(surfaces), 2):
        ends = surfaces.shared(i), surfaces.shared(j)
        how = {"group": group, "turned": (i in turned, j in turned)}
        wanted[i, j] = Wanted(
            key=OVERLAPPING.key(how, *(end.key for end in ends)),
            label=shapes.label(i, j),
            arguments={"target": ends[0], "source": ends[1], **how},
        )
    found = session.compute(OVERLAPPING, wanted, time_limit_s=session.run.pair_time_limit_s)
    return {pair: poses for pair, poses in found.items() if len(poses)}
