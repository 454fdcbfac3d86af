"""Generated collections that try the confidence: symmetric, mixed, damaged, unrelated shapes, and noise."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_tools.arrays import FloatArray
from data_tools.datasets.synthetic import (
    bent,
    bumped,
    deformed_family,
    planted_collection,
    point_cloud,
)
from data_tools.datasets.synthetic_shapes import blob, chair, crown, figure, sphere_mesh
from data_tools.io.shapes import write_mesh
from data_tools.rotations import random_rotation
from data_tools.surface.shape import Shape
from experiments.collections.posed import PosedCollection
from experiments.pairs.incomplete import without_share
from experiments.peers.bones import bone

NUM_VERTICES = 1200
#: Root mean square height of bumps, as a share of the diagonal, of families that one should get right.
EASY_RMS = 0.02
#: The same, of families at the edge of what can be told.
HARD_RMS = 0.06

#: Deviation of the logarithm of a stretched shape's proportions.
STRETCH = 0.15

#: Deviation of the noise on a rough surface, as a share of the diagonal.
ROUGHNESS = 0.01
#: Points that are kept of a shape without its surface.
NUM_POINTS = 2000

Make = Callable[[np.random.Generator], Shape]
Change = Callable[[Shape, np.random.Generator], Shape]
Members = Callable[[int, np.random.Generator], tuple[Shape, ...]]


@dataclass(frozen=True, kw_only=True)
class Family:
    """A kind of generated collection.

    Attributes
    ----------
    members : callable
        ``members(num, rng)``: shapes in one frame, named with digits at the end.
    related : bool
        Whether there is a right answer; where there is none, every pose that is not in doubt is wrong.
    symmetric : bool
        Whether the shapes look exactly the same in several poses, so that a word about it is owed.
    group : {"SO", "O"}
        Whether members are mirrored at random.
    """

    members: Members
    related: bool = True
    symmetric: bool = False
    group: str = "SO"


def radial(extent: Callable[[FloatArray], FloatArray], name: str) -> Shape:
    """Return the closed surface whose point in the direction u lies at ``extent(u)`` from the centre."""
    directions, faces = sphere_mesh(NUM_VERTICES)
    return Shape.from_arrays(directions * extent(directions)[:, None], faces, name=name)


def box(sides: FloatArray, name: str = "box") -> Shape:
    """Return a box of half sides (3,), centred."""
    return radial(lambda u: 1.0 / np.abs(u / sides).max(axis=1), name)


def cylinder(height: float, name: str = "cylinder") -> Shape:
    """Return an upright cylinder of radius 1 and this half height, centred."""

    def extent(u: FloatArray) -> FloatArray:
        around = np.hypot(u[:, 0], u[:, 1])
        return 1.0 / np.maximum(around, np.abs(u[:, 2]) / height)

    return radial(extent, name)


def numbered(make: Make) -> Members:
    """Return a family of independent draws."""

    def members(num: int, rng: np.random.Generator) -> tuple[Shape, ...]:
        shapes = (make(rng) for _ in range(num))
        return tuple(
            Shape(name=f"{s.name}{i:02d}", vertices=s.vertices, faces=s.faces)
            for i, s in enumerate(shapes, 1)
        )

    return members


def copies(make: Make, rms: float) -> Members:
    """Return a family of bumped copies of one draw."""
    return lambda num, rng: deformed_family(make(rng), num, rng, rms=rms)


def mixture(num: int, rng: np.random.Generator) -> tuple[Shape, ...]:
    """Return chairs and, half as many, figures."""
    first = -(-2 * num // 3)
    return (
        *copies(chair, EASY_RMS)(first, rng),
        *copies(lambda _: figure(), EASY_RMS)(num - first, rng),
    )


def noise_cloud(rng: np.random.Generator) -> Shape:
    """Return points drawn from a Gaussian: nothing to be matched."""
    return Shape.from_arrays(rng.standard_normal((NUM_VERTICES, 3)), name="noise")


def changed(make: Make, change: Change) -> Members:
    """Return a family of bumped copies of one draw, each changed in its own way."""

    def members(num: int, rng: np.random.Generator) -> tuple[Shape, ...]:
        return tuple(change(shape, rng) for shape in copies(make, EASY_RMS)(num, rng))

    return members


def stretched(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return a shape of other proportions along three random axes."""
    axes = random_rotation(rng)
    stretch = (axes * np.exp(STRETCH * rng.standard_normal(3))) @ axes.T
    return Shape.from_arrays(shape.vertices @ stretch, shape.faces, name=shape.name)


def roughened(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return a shape with noise on every vertex, one by one, which leaves a surface of spikes."""
    rough = point_cloud(shape, rng, noise=ROUGHNESS).vertices
    return Shape.from_arrays(rough, shape.faces, name=shape.name)


def as_points(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return some points of a shape without its triangles, with half of that noise."""
    cloud = point_cloud(shape, rng, noise=ROUGHNESS / 2)
    kept = np.sort(rng.permutation(len(cloud.vertices))[:NUM_POINTS])
    return Shape.from_arrays(cloud.vertices[kept], name=shape.name)


#: Shapes of which changed families are made, and what is done to each member.
BASES: dict[str, Make] = {
    "crowns": crown,
    "chairs": chair,
    "figures": lambda _: figure(),
    "blobs": lambda rng: blob(rng, num_vertices=NUM_VERTICES),
    "bones": lambda rng: bone(*sphere_mesh(NUM_VERTICES), rng, "bone"),
}
CHANGES: dict[str, Change] = {
    "bumpy": lambda shape, rng: bumped(shape, rng, rms=HARD_RMS),
    "bent": bent,
    "rough": roughened,
    "points": as_points,
    "cut": lambda shape, rng: without_share(shape, rng.standard_normal(3), 0.25),
    "stretched": stretched,
}
FAMILIES: dict[str, Family] = {
    "crowns": Family(members=copies(crown, EASY_RMS)),
    "crowns, mirrored": Family(members=copies(crown, EASY_RMS), group="O"),
    "chairs": Family(members=numbered(lambda rng: bumped(chair(rng), rng, rms=EASY_RMS))),
    "bent figures": Family(members=numbered(lambda rng: bent(figure(), rng))),
    "near boxes": Family(
        members=numbered(lambda rng: bumped(box(np.array([1.0, 0.8, 0.6])), rng, rms=0.01))
    ),
    "chairs and figures": Family(members=mixture),
    "unrelated blobs": Family(
        members=numbered(lambda rng: blob(rng, num_vertices=NUM_VERTICES)), related=False
    ),
    "noise": Family(members=numbered(noise_cloud), related=False),
    "boxes": Family(members=numbered(lambda _: box(np.array([1.0, 0.8, 0.6]))), symmetric=True),
    "cubes": Family(members=numbered(lambda _: box(np.ones(3))), symmetric=True),
    "cylinders": Family(members=numbered(lambda _: cylinder(1.5)), symmetric=True),
    "spheres": Family(
        members=numbered(lambda _: radial(lambda u: np.ones(len(u)), "sphere")), symmetric=True
    ),
    **{
        f"{base}, {change}": Family(members=changed(BASES[base], CHANGES[change]))
        for base, change in itertools.product(BASES, CHANGES)
    },
}


def pose_family(
    family: Family, num: int, folder: Path, rng: np.random.Generator
) -> PosedCollection:
    """Write a generated collection in random poses.

    Parameters
    ----------
    family : Family
    num : int
    folder : Path
        Gets one PLY file per shape.
    rng : numpy.random.Generator
    """
    planted = planted_collection(family.members(num, rng), rng, group=family.group)
    for shape in planted.shapes:
        write_mesh(folder / f"{shape.name}.ply", shape)
    relative = np.einsum("ica,jcb->ijab", planted.rotations, planted.rotations)
    return PosedCollection(
        folder=folder, names=tuple(s.name for s in planted.shapes), relative=relative
    )
