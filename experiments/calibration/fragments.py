"""The weights that rank and judge poses of incomplete shapes, fitted on pieces of 10 to 80 % among complete ones.

Every other piece is closed at its breaks, as a segmentation of a tomogram or a scan from all around leaves it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from collalign.confidence import incomplete_model
from collalign.engine.records import Record
from collalign.stages.incomplete.place import place_shape
from data_tools.arrays import BoolArray, FloatArray
from data_tools.datasets.synthetic_shapes import sphere_mesh
from data_tools.embedding.surface_points import spread_points
from data_tools.partial_surface import MOST_POINTS
from data_tools.poses import Similarity
from data_tools.rotations import random_rotation, rotation_angle_deg
from data_tools.surface.shape import Shape
from experiments.calibration.scan import Calibration, Finding, constants_of
from experiments.collections.landmarked import read_dataset
from experiments.pairs.incomplete import without_share
from experiments.peers.bones import bone
from pairwise.partial_match import refine

BONES = "bones"
#: Pieces of each collection, and of which shapes they and their partners are.
NUM_PIECES, NUM_QUICK, NUM_SHAPES, NUM_PARTNERS, SEED = 20, 2, 20, 7, 1
#: A pose is right within this angle here: landmarks of shapes that bend differ by more than 15 degrees from surfaces.
NEAR_DEG = 25.0
#: How much the squared weights, in deviations of their evidence, count beside the mean logarithm of what is right.
RIDGE = 0.002
NUM_VERTICES = 5000
#: Rings that fill a break, as shares of their distance from its middle, and their roughness, in parts of its radius.
RINGS, ROUGHNESS = (0.8, 0.6, 0.4, 0.2), 0.04


def broken(shape: Shape, axis: FloatArray, left: float, rng: np.random.Generator) -> Shape:
    """Return about so large a share of a shape, at one end of an axis: one piece with a wavy, open break."""
    axis = axis / np.linalg.norm(axis)
    arms = shape.vertices - shape.vertices.mean(axis=0)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    across = np.stack([arms @ first, arms @ np.cross(axis, first)])
    around = np.arctan2(across[1], across[0])
    waves = sum(
        rng.standard_normal() / k * np.cos(k * around + rng.uniform(0.0, 2.0 * np.pi))
        for k in (1, 2, 3, 5)
    )
    heights = (
        arms @ axis + 0.2 * rng.uniform(0.3, 1.0) * np.sqrt((across**2).sum(axis=0).mean()) * waves
    )
    kept: BoolArray = heights <= np.quantile(heights, left)
    faces = shape.faces[kept[shape.faces].all(axis=1)]
    links = coo_array(
        (np.ones(2 * len(faces)), faces[:, [0, 1, 1, 2]].reshape(-1, 2).T), shape=(len(kept),) * 2
    )
    piece = connected_components(links, directed=False)[1][faces[:, 0]]
    used, renumbered = np.unique(faces[piece == np.bincount(piece).argmax()], return_inverse=True)
    return Shape.from_arrays(shape.vertices[used], renumbered.reshape(-1, 3), name=shape.name)


def broken_bone(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return one end of a bone, broken across the shaft; of some both ends are lost."""
    end = np.array(
        [0.15 * rng.standard_normal(), 0.15 * rng.standard_normal(), rng.choice([-1.0, 1.0])]
    )
    if rng.random() < 0.15:
        return broken(
            broken(shape, end, rng.uniform(0.55, 0.75), rng), -end, rng.uniform(0.3, 0.6), rng
        )
    return broken(shape, end, rng.uniform(0.1, 0.8), rng)


def closed(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return a shape whose open borders are filled by rough surfaces, ring by ring towards the middle of each."""
    num = len(shape.vertices)
    sides = shape.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    border = sides[~np.isin(sides @ [num, 1], sides @ [1, num])]
    rim, ends = np.unique(border, return_inverse=True)
    ends = ends.reshape(-1, 2)
    links = coo_array((np.ones(len(ends)), ends.T), shape=(len(rim),) * 2)
    num_loops, loop = connected_components(links, directed=False)
    sizes = np.bincount(loop, minlength=num_loops)[:, None]
    middles = np.zeros((num_loops, 3))
    np.add.at(middles, loop, shape.vertices[rim])
    arms = shape.vertices[rim] - (middles / sizes)[loop]
    vertices, faces, outer = [shape.vertices], [shape.faces], rim
    for ring, share in enumerate(RINGS):
        inner = num + ring * len(rim) + np.arange(len(rim))
        rough = ROUGHNESS * np.linalg.norm(arms, axis=1).mean() * rng.standard_normal(arms.shape)
        vertices.append((middles / sizes)[loop] + share * arms + rough)
        (first, second), (third, fourth) = outer[ends].T, inner[ends].T
        faces.append(np.stack([second, first, third], axis=1))
        faces.append(np.stack([second, third, fourth], axis=1))
        outer = inner
    centre = num + len(RINGS) * len(rim) + loop
    faces.append(np.stack([outer[ends[:, 1]], outer[ends[:, 0]], centre[ends[:, 0]]], axis=1))
    return Shape.from_arrays(
        np.concatenate([*vertices, middles / sizes]), np.concatenate(faces), name=shape.name
    )


def cut_or_broken(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return a shape without a quarter beyond a plane, or a piece of it."""
    if rng.random() < 0.5:
        return without_share(shape, rng.standard_normal(3), 0.25)
    return broken(shape, rng.standard_normal(3), rng.uniform(0.1, 0.8), rng)


def complete_shapes(
    data: Path, collection: str, rng: np.random.Generator
) -> tuple[list[Shape], list[FloatArray], Callable[[Shape, np.random.Generator], Shape]]:
    """Return shapes, the transform (4, 4) of each to a common frame, and how they break."""
    if collection == BONES:
        directions, faces = sphere_mesh(NUM_VERTICES)
        shapes = [bone(directions, faces, rng, f"bone{i:02d}") for i in range(NUM_SHAPES)]
        return shapes, [np.eye(4)] * NUM_SHAPES, broken_bone
    dataset = read_dataset(collection, data)
    eligible = (
        np.arange(len(dataset))
        if dataset.chirality is None
        else np.flatnonzero(dataset.chirality == 1)
    )
    chosen = rng.permutation(eligible)[:NUM_SHAPES].tolist()
    shapes = [dataset.shape(i) for i in chosen]
    points = [spread_points(shape, MOST_POINTS) for shape in shapes]
    transforms = []
    for i, one in zip(chosen, points, strict=True):
        surface, rotation = one, dataset.rotation(chosen[0], i)
        pose = Similarity(
            rotation=rotation,
            scale=1.0 / surface.radius,
            shift=-rotation @ surface.centre / surface.radius,
        )
        transforms.append(pose.transform)
    still = Similarity.rigid(np.eye(3)[None], np.zeros((1, 3)))
    for _ in range(2):
        posed = [one.moved(transform) for one, transform in zip(points, transforms, strict=True)]
        for i, surface in enumerate(posed):
            others = [other for j, other in enumerate(posed) if j != i][:NUM_PARTNERS]
            moved = refine(others, surface, still, scale_range=(0.7, 1.4), hold_rotations=True)
            transforms[i] = moved.transform[0] @ transforms[i]
    return shapes, transforms, cut_or_broken


def pieces(data: Path, collection: str, num: int) -> list[tuple[FloatArray, BoolArray]]:
    """Return the evidence (3, m) of the poses of each piece, and which of them are right."""
    rng = np.random.default_rng(SEED)
    shapes, transforms, cut = complete_shapes(data, collection, rng)
    points = [spread_points(shape, MOST_POINTS) for shape in shapes]
    found = []
    for n in range(num):
        i = n % len(shapes)
        partners = rng.permutation(np.delete(np.arange(len(shapes)), i))[:NUM_PARTNERS].tolist()
        piece, rotation = cut(shapes[i], rng), random_rotation(rng)
        piece = closed(piece, rng) if n % 2 else piece
        rotated = Shape.from_arrays(piece.vertices @ rotation.T, piece.faces, name=piece.name)
        record: Record = place_shape(
            spread_points(rotated, MOST_POINTS),
            tuple(points[j] for j in partners),
            np.stack([transforms[j] for j in partners]),
            "SO",
            estimate_scale=True,
        )
        true = Similarity.of_transforms(transforms[i][None]).rotation[0] @ rotation.T
        found.append(
            (record["evidence"], rotation_angle_deg(record["rotations"], true) <= NEAR_DEG)
        )
    return found


def fit_ranking(collections: Sequence[Sequence[tuple[FloatArray, BoolArray]]]) -> FloatArray:
    """Return the weights (3,) of a conditional logit that gives right poses the most; collections weigh the same."""
    used = [
        (e, right, 1.0 / len(one))
        for one in collections
        for e, right in one
        if right.any() and not right.all()
    ]
    size = np.concatenate([evidence for evidence, _, _ in used], axis=1).std(axis=1)

    def loss(weights: FloatArray) -> float:
        total = 0.0
        for evidence, right, share in used:
            odds = -(weights / size) @ evidence
            odds -= odds.max()
            total -= share * np.log(np.exp(odds[right]).sum() / np.exp(odds).sum() + 1e-12)
        return total / len(collections) + RIDGE * float(weights @ weights)

    return np.asarray(minimize(loss, np.ones(len(size)), method="L-BFGS-B").x / size)


def measure_weights(data: Path, collections: Sequence[str], quick: bool) -> dict[str, Finding]:
    """Fit the weights, and judge each collection by those fitted without it."""
    found = {one: pieces(data, one, NUM_QUICK if quick else NUM_PIECES) for one in collections}

    def right(collection: str, weights: FloatArray) -> float:
        return float(
            np.mean(
                [
                    is_right[np.argmin(weights @ evidence)]
                    for evidence, is_right in found[collection]
                ]
            )
        )

    now = np.array(incomplete_model.PIECE_WEIGHTS)
    fitted = fit_ranking([*found.values()])
    without = {
        one: fit_ranking([found[c] for c in found if c != one]) if len(found) > 1 else fitted
        for one in found
    }
    return {
        "PIECE_WEIGHTS": Finding(
            value=tuple(fitted.tolist()),
            now=float(np.mean([right(one, now) for one in found])),
            best=float(np.mean([right(one, fitted) for one in found])),
            left_out=float(np.mean([right(one, without[one]) for one in found])),
        )
    }


CALIBRATION = Calibration(
    module=incomplete_model.__name__,
    constants=constants_of(incomplete_model, "PIECE_WEIGHTS"),
    measure=measure_weights,
    collections=("ant", "teddy", "chair", "fish", "teeth", "horse", "mouse skulls", BONES),
    score=f"share of pieces of 10 to 80 % whose likeliest pose is within {NEAR_DEG:.0f} degrees",
)
