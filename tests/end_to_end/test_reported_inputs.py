"""Collections as people reported them of other programs: each is aligned, or said to be in doubt."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from collalign import AlignOptions, RunOptions, align_collection
from data_tools.datasets.synthetic import deformed_family
from data_tools.datasets.synthetic_shapes import blob
from data_tools.options import SamplingOptions
from data_tools.rotations import random_rotation
from tests.finished_runs import angles_deg
from tests.notes import codes

NUM_SHAPES = 5
PLACE = np.array([456789.123, 5412345.678, 312.4])
OPTIONS = AlignOptions(group="auto", sampling=SamplingOptions(num_points=48))


def family(rng, num_vertices):
    """Return blobs of three different widths that vary."""
    base = blob(rng, num_vertices=num_vertices)
    return deformed_family(
        replace(base, vertices=base.vertices * [1.6, 1.0, 0.75]), NUM_SHAPES, rng, rms=0.03
    )


def inside_out(rng):
    """Meshes of which some have all faces turned round, and one is in another unit."""
    return [
        (s.vertices * (0.001 if at == 2 else 1.0), s.faces[:, :: 1 - 2 * (at in (1, 3))])
        for at, s in enumerate(family(rng, 600))
    ]


def scanned(rng):
    """Clouds, some sampled evenly, some as scanners do: dense on one side, with noise and points from elsewhere."""
    for at, shape in enumerate(family(rng, 600)):
        samples, _ = trimesh.sample.sample_surface(
            trimesh.Trimesh(shape.vertices, shape.faces), 9000, seed=at
        )
        if at % 2:
            samples = samples[rng.random(len(samples)) < np.where(samples[:, 1] > 0.2, 1.0, 1 / 8)]
            samples = samples + 0.01 * rng.standard_normal(samples.shape)
            stray = rng.choice(len(samples), len(samples) * 3 // 100, replace=False)
            samples[stray] = rng.uniform(-2.2, 2.2, (len(stray), 3))
        yield samples[:3000], None


def blades(rng):
    """Thin, bent leaves: nearly flat, nearly symmetric."""
    sphere = deformed_family(blob(rng, num_vertices=900), 1, rng, rms=0.0)[0]
    unit = sphere.vertices / np.linalg.norm(sphere.vertices, axis=1, keepdims=True)
    for _ in range(NUM_SHAPES):
        x, y, z = (unit * [5.0, 1.5, 0.3]).T
        z = z + 0.035 * x**2 * (1 + 0.2 * rng.standard_normal())
        y = y * (1 + 0.05 * x * (1 + 0.1 * rng.standard_normal()))
        z = z + 0.25 * np.exp(-((x - 3.2) ** 2 + y**2) / 0.6) * (unit[:, 2] > 0)
        yield np.column_stack([x, y, z]), sphere.faces


def broken(rng):
    """A shape that lacks a third, closed by a flat face, among whole ones."""
    for at, shape in enumerate(family(rng, 300)):
        points = shape.vertices.copy()
        if at == 3:
            normal = np.array([0.92, 0.31, 0.2]) / np.linalg.norm([0.92, 0.31, 0.2])
            beyond = np.maximum(points @ normal - np.quantile(points @ normal, 0.68), 0.0)
            points -= beyond[:, None] * normal
        yield points, shape.faces


def on_stands(rng):
    """Bones two of which are fused, at a corner, with the block that they were glued on."""
    for at, shape in enumerate(family(rng, 600)):
        points, faces = shape.vertices, shape.faces
        if at % 2:
            block = trimesh.creation.box((0.5, 0.5, 0.35)).subdivide().subdivide().subdivide()
            lowest = int(points[:, 2].argmin())
            corners = block.vertices + points[lowest] + [0.05, 0.0, -0.15]
            nearest = int(np.linalg.norm(corners - points[lowest], axis=1).argmin())
            beside = next(one for one in faces[(faces == lowest).any(axis=1)][0] if one != lowest)
            joint = [lowest, beside, len(points) + nearest]
            faces = np.concatenate([faces, block.faces + len(points), [joint]])
            points = np.concatenate([points, corners])
        yield points, faces


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (inside_out, {"much-smaller"}),
        (scanned, set()),
        (blades, set()),
        (broken, set()),
        (on_stands, set()),
    ],
)
def test_poses_are_right_on_a_map(kind, said):
    """All are at the coordinates of a map, metres and millimetres alike."""
    rng = np.random.default_rng(0)
    turns = [random_rotation(rng) for _ in range(NUM_SHAPES)]
    sizes = rng.uniform(0.5, 2.0, NUM_SHAPES)
    given = [
        (size * points @ turn.T + PLACE, faces)
        if faces is not None
        else size * points @ turn.T + PLACE
        for (points, faces), turn, size in zip(kind(rng), turns, sizes, strict=True)
    ]
    found = align_collection(given, options=OPTIONS, run=RunOptions(jobs=1), progress=False)
    assert not found.reflected.any()
    assert np.median(angles_deg(found.rotations @ turns), axis=0).max() < (
        15.0 if kind is broken else 10.0
    )
    assert kind is not on_stands or "maps" not in found.run.times_s
    assert said <= {*codes(found.notes)}


def bumpy(number, subdivisions, own=0.05):
    """Return surface ``number`` of a family without any symmetry: nine large bumps, and six small ones of its own."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    radii = np.ones(len(sphere.vertices))
    for seed, num, size in ((7, 9, 0.7), (1000 + number, 6, own)):
        rng = np.random.default_rng(seed)
        places = rng.normal(size=(num, 3))
        places /= np.linalg.norm(places, axis=1, keepdims=True)
        heights, widths = size * rng.uniform(-1, 1, num), rng.uniform(4, 9, num)
        radii += (heights * np.exp(widths * (sphere.vertices @ places.T - 1.0))).sum(axis=1)
    return sphere.vertices * radii[:, None] * [1.6, 1.0, 0.75], np.array(sphere.faces)
