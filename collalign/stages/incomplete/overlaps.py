"""Every pair of shapes by what they share: poses on which neighbourhoods agree, in the units of the files."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from collalign.engine.job import Job, Results, Wanted
from collalign.options import AlignSession
from collalign.products.shapes import Shapes
from data_tools.embedding.surface_points import surface_cells
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.local_surface import PART_CELL, LocalSurface
from data_tools.options import CleaningOptions
from pairwise.features.overlap import LocalPoses, match_overlapping

#: Cells are powers of two to this share, so that a shape more does not change that of all others.
_STEPS_AN_OCTAVE = 4
#: Poses that a pair keeps.
NUM_CANDIDATES = 6


def describe_file(
    path: Origin, name: str, digest: str, cleaning: CleaningOptions, cell: float
) -> LocalSurface:
    """Read one surface and describe its neighbourhoods, unless it has changed since its digest was taken.

    Raises
    ------
    InputError
        If the surface has too few points.
    """
    found = surface_cells(read_shape(path, cleaning, name=name, digest=digest), cell)
    if found is None:
        raise InputError(f"{name}: too few points to describe neighbourhoods of {cell:.3g}")
    return found


def overlap_pair(target: LocalSurface, source: LocalSurface, group: str) -> LocalPoses:
    """Return the poses on which two surfaces share most; runs inside a worker."""
    return match_overlapping(target, source, group=group, num_candidates=NUM_CANDIDATES)


#: Describes a surface. The version changes whenever the same file and cell would give another one.
DESCRIBING = Job(kind="surfaces", version="local-3", run=describe_file, reader=LocalSurface)
#: Matches a pair by what both share. The version changes whenever the same surfaces would give other poses.
OVERLAPPING = Job(kind="evidence", version="overlap-5", run=overlap_pair, reader=LocalPoses)


def common_cell(shapes: Shapes) -> float:
    """Return the distance of points at which all shapes are described, in the units of the files."""
    radii = [
        item.scale * np.sqrt((item.positions**2).sum(axis=1).mean()) for item in shapes.samples
    ]
    octaves = np.log2(PART_CELL * float(np.median(radii)))
    return float(2.0 ** (np.round(_STEPS_AN_OCTAVE * octaves) / _STEPS_AN_OCTAVE))


def describe_surfaces(
    session: AlignSession, shapes: Shapes, chosen: Sequence[int]
) -> Results[int, LocalSurface]:
    """Return the described surfaces of some shapes, by position; shapes of too few points are left out."""
    cell = common_cell(shapes)
    wanted = {}
    for i in chosen:
        arguments = {
            "path": shapes.files[i],
            "name": shapes.names[i],
            "digest": shapes.digests[i],
            "cleaning": session.options.cleaning,
            "cell": cell,
        }
        key = DESCRIBING.key({"cell": cell}, shapes.keys[i])
        wanted[i] = Wanted(key=key, label=shapes.names[i], arguments=arguments)
    return session.compute(DESCRIBING, wanted, time_limit_s=session.run.shape_time_limit_s)


def overlap_pairs(
    session: AlignSession, shapes: Shapes, surfaces: Results[int, LocalSurface]
) -> dict[tuple[int, int], LocalPoses]:
    """Return what every two surfaces share, by target and source."""
    group, wanted = session.options.group, {}
    for i, j in itertools.combinations(sorted(surfaces), 2):
        ends = surfaces.shared(i), surfaces.shared(j)
        wanted[i, j] = Wanted(
            key=OVERLAPPING.key({"group": group}, *(end.key for end in ends)),
            label=shapes.label(i, j),
            arguments={"target": ends[0], "source": ends[1], "group": group},
        )
    found = session.compute(OVERLAPPING, wanted, time_limit_s=session.run.pair_time_limit_s)
    return {pair: poses for pair, poses in found.items() if len(poses)}
