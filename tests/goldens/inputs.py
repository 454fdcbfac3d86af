"""The collections of the goldens: generated, small, one for each kind of run."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from data_tools.datasets.synthetic import (
    bent,
    deformed_family,
    mirrored,
    planted_collection,
    point_cloud,
)
from data_tools.datasets.synthetic_shapes import blob, chair, crown, figure
from data_tools.io.shapes import write_mesh
from data_tools.surface.shape import Shape
from experiments.calibration.fragments import broken
from tests.collalign.stages.test_mixed_sides import lopsided

#: Digits of the coordinates: another processor, whose last bits differ, writes the same files.
DIGITS = 4


@dataclass(frozen=True)
class Golden:
    """Shapes in random poses, and the keywords of ``align_collection``."""

    shapes: tuple[Shape, ...]
    keywords: dict[str, Any] = field(default_factory=dict)

    def write(self, folder):
        """Write the shapes into a new folder, a path."""
        folder.mkdir()
        for shape in self.shapes:
            rounded = Shape.from_arrays(shape.vertices.round(DIGITS), shape.faces)
            write_mesh(folder / f"{shape.name}.ply", rounded)


def rigid():
    """Return chairs of several sizes."""
    rng = np.random.default_rng(1)
    family = deformed_family(chair(rng, resolution=1), 6, rng, rms=0.02)
    return Golden(planted_collection(family, rng, scale_range=(0.7, 1.5)).shapes)


def sides():
    """Return left and right specimens without symmetry; the run decides that two of seven are mirrored."""
    rng = np.random.default_rng(2)
    family = deformed_family(lopsided(crown(rng, num_vertices=300)), 7, rng, rms=0.01)
    mixed = [mirrored(shape) if i in (1, 4) else shape for i, shape in enumerate(family)]
    return Golden(planted_collection(mixed, rng).shapes)


def fragment():
    """Return blobs of which one is broken; the run finds it."""
    rng = np.random.default_rng(3)
    family = [*deformed_family(blob(rng, num_vertices=500), 6, rng, rms=0.01)]
    family[3] = broken(family[3], np.array([0.0, 0.1, 1.0]), 0.6, rng)
    return Golden(planted_collection(family, rng).shapes, {"group": "SO", "maps": "never"})


def bodies():
    """Return bodies that bend, of which all vertices are mapped."""
    rng = np.random.default_rng(4)
    straight = blob(rng, num_vertices=500)
    family = [replace(bent(straight, rng, angle=0.5), name=f"body{i}") for i in range(3)]
    return Golden(
        planted_collection(family, rng).shapes,
        {"group": "SO", "maps": "always", "deformable": True},
    )


def clouds():
    """Return noisy point clouds."""
    rng = np.random.default_rng(5)
    family = deformed_family(crown(rng, num_vertices=400), 6, rng, rms=0.01)
    return Golden(
        planted_collection([point_cloud(shape, rng, noise=0.005) for shape in family], rng).shapes
    )


def kinds():
    """Return six blobs and six figures, which the run separates."""
    return Golden(two_kinds(6).shapes, {"clusters": 2, "maps": "never"})


def two_kinds(num):
    """Return as many blobs, and then figures, in random poses."""
    rng = np.random.default_rng(6)
    two = blob(rng, num_vertices=400), figure(resolution=1)
    family = [shape for kind in two for shape in deformed_family(kind, num, rng, rms=0.005)]
    return planted_collection(family, rng)


#: Every collection by its name.
GOLDENS = {make.__name__: make for make in (rigid, sides, fragment, bodies, clouds, kinds)}
