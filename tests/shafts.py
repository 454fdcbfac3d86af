"""A shape that looks the same however it is turned about its axis."""

import numpy as np

from data_tools.surface.shape import Shape


def stepped_shaft():
    """Return a closed surface of revolution about the third axis."""
    heights, angles = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 2 * np.pi, 49)[:-1])
    radii = 0.15 + 0.1 * (heights > 0.6) + 0.05 * heights
    rim = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=2)
    vertices, around = rim.reshape(-1, 3), len(angles)
    first = (np.arange(around)[:, None] * 40 + np.arange(39)).ravel()
    second = (first + 40) % len(vertices)
    sides = [np.stack([first, second, second + 1], 1), np.stack([first, second + 1, first + 1], 1)]
    ring = np.arange(around) * 40
    bottom, top = len(vertices), len(vertices) + 1
    after = np.roll(ring, -1)
    caps = [
        np.stack([np.full(around, bottom), after, ring], 1),
        np.stack([np.full(around, top), ring + 39, after + 39], 1),
    ]
    vertices = np.concatenate([vertices, [[0, 0, 0], [0, 0, 1]]])
    return Shape.from_arrays(vertices, np.concatenate(sides + caps), name="shaft")
