"""Generated objects that are assembled of separate boxes and cylinders, as modellers make furniture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.shape import Shape

Part = tuple[FloatArray, IntArray]
#: Corners around a cylinder.
_NUM_SIDES = 16
#: The triangles of a box whose corners count x, y, z in binary, counterclockwise from outside.
_BOX_FACES = np.array(
    [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]
)  # fmt: skip
X, Y, Z = 0, 1, 2


def box(size: Sequence[float], centre: Sequence[float]) -> Part:
    """Return a box of eight corners: vertices (8, 3) and triangles (12, 3)."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3)))
    return corners * np.asarray(size) + np.asarray(centre), _BOX_FACES


def cylinder(
    radius: float, length: float, centre: Sequence[float], axis: int = Z, *, top: float = 1.0
) -> Part:
    """Return a closed cylinder along a coordinate axis; its upper radius is ``top`` times the lower one."""
    angles = 2.0 * np.pi * np.arange(_NUM_SIDES) / _NUM_SIDES
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    half = np.full((_NUM_SIDES, 1), length / 2)
    ends = np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]])
    vertices = np.concatenate([np.hstack([ring, -half]), np.hstack([top * ring, half]), ends])
    low = np.arange(_NUM_SIDES)
    after, bottom = (low + 1) % _NUM_SIDES, np.full(_NUM_SIDES, 2 * _NUM_SIDES)
    faces = np.concatenate(
        [
            np.column_stack([low, after, after + _NUM_SIDES]),
            np.column_stack([low, after + _NUM_SIDES, low + _NUM_SIDES]),
            np.column_stack([after, low, bottom]),
            np.column_stack([low + _NUM_SIDES, after + _NUM_SIDES, bottom + 1]),
        ]
    )
    return np.roll(vertices, axis - Z, axis=1) + np.asarray(centre), faces


def chair(rng: np.random.Generator) -> list[Part]:
    """Return a chair: seat, back, four legs, perhaps with arms."""
    width, depth, height, back = rng.uniform([0.8, 0.8, 0.7, 0.7], [1.2, 1.2, 1.1, 1.3])
    thick = rng.uniform(0.06, 0.12)
    parts = [
        box((width, depth, thick), (0, 0, 0)),
        box((width, thick, back), (0, -depth / 2, back / 2)),
        *_legs(width, depth, height, thick),
    ]
    if rng.random() < 0.5:
        parts += [
            box((thick, depth, thick), (side * width / 2, 0, 0.35 * back)) for side in (-1, 1)
        ]
    return parts


def mug(rng: np.random.Generator) -> list[Part]:
    """Return a mug with a lid, whose handle is three boxes."""
    radius, height, reach = rng.uniform([0.4, 0.9, 0.25], [0.6, 1.3, 0.45])
    low, high = height * rng.uniform([-0.35, 0.1], [-0.2, 0.3])
    return [
        cylinder(radius, height, (0, 0, 0)),
        cylinder(1.08 * radius, 0.08, (0, 0, height / 2 + 0.04)),
        box((reach, 0.12, 0.1), (radius + reach / 2, 0, low)),
        box((reach, 0.12, 0.1), (radius + reach / 2, 0, high)),
        box((0.1, 0.12, high - low + 0.1), (radius + reach, 0, (low + high) / 2)),
    ]


def car(rng: np.random.Generator) -> list[Part]:
    """Return a car: body, cabin towards the rear, four wheels, lamps in front."""
    length, width, height = rng.uniform([2.4, 1.0, 0.4], [3.2, 1.3, 0.6])
    cabin, wheel = rng.uniform([0.4, 0.24], [0.6, 0.34])
    wheels = [
        cylinder(wheel, 0.18, (x * length, side * width / 2, -height / 2), Y)
        for x in (-0.33, 0.33)
        for side in (-1, 1)
    ]
    lamps = [
        box((0.08, 0.15, 0.12), (length / 2 + 0.04, side * width / 3, 0.05)) for side in (-1, 1)
    ]
    return [
        box((length, width, height), (0, 0, 0)),
        box((0.5 * length, 0.9 * width, cabin), (-0.18 * length, 0, (height + cabin) / 2)),
        *wheels,
        *lamps,
    ]


def computer(rng: np.random.Generator) -> list[Part]:
    """Return a screen on its stand, with a keyboard in front of it and a mouse at one side."""
    width, height, away = rng.uniform([1.2, 0.7, 0.5], [1.7, 1.0, 0.8])
    return [
        box((width, 0.08, height), (0, 0, 0.3 + height / 2)),
        box((0.1, 0.08, 0.35), (0, 0.06, 0.17)),
        box((0.5, 0.35, 0.04), (0, 0.05, 0)),
        box((0.75 * width, 0.35, 0.05), (-0.1, -away, 0)),
        box((0.12, 0.2, 0.07), (0.45 * width, -away, 0)),
    ]


def lamp(rng: np.random.Generator) -> list[Part]:
    """Return a desk lamp: base, pole, an arm to one side and a shade at its end."""
    height, reach, shade = rng.uniform([1.2, 0.6, 0.25], [1.8, 1.0, 0.4])
    return [
        cylinder(rng.uniform(0.3, 0.45), 0.08, (0, 0, 0)),
        cylinder(0.05, height, (0, 0, height / 2)),
        cylinder(0.05, reach, (reach / 2, 0, height), X),
        cylinder(shade, 0.4, (reach, 0, height - 0.2), top=0.45),
    ]


def bed(rng: np.random.Generator) -> list[Part]:
    """Return a bed: frame, mattress, pillows, a high board at the head and a low one at the foot."""
    length, width, head = rng.uniform([2.0, 1.2, 0.7], [2.4, 1.9, 1.1])
    pillows = [
        box((0.35, 0.38 * width, 0.12), (-0.36 * length, side * width / 4, 0.46))
        for side in (-1, 1)
    ]
    return [
        box((length, width, 0.15), (0, 0, 0.1)),
        box((0.96 * length, 0.94 * width, 0.22), (0, 0, 0.29)),
        box((0.08, width, head), (-length / 2, 0, head / 2 - 0.1)),
        box((0.08, width, 0.4 * head), (length / 2, 0, 0.2 * head - 0.1)),
        *pillows,
        *_legs(length, width, 0.3, 0.12),
    ]


def sofa(rng: np.random.Generator) -> list[Part]:
    """Return a sofa: base, back, arms and one to three cushions."""
    width, depth, back = rng.uniform([1.6, 0.8, 0.5], [2.6, 1.1, 0.8])
    num = int(rng.integers(1, 4))
    cushion = (width - 0.4) / num
    cushions = [
        box(
            (0.96 * cushion, 0.8 * depth, 0.18),
            ((k + 0.5) * cushion - width / 2 + 0.2, 0.05, 0.29),
        )
        for k in range(num)
    ]
    arms = [box((0.2, depth, 0.55), (side * (width / 2 - 0.1), 0, 0.2)) for side in (-1, 1)]
    return [
        box((width, depth, 0.3), (0, 0, 0.05)),
        box((width, 0.2, back), (0, -depth / 2 - 0.1, back / 2)),
        *arms,
        *cushions,
    ]


def bike(rng: np.random.Generator) -> list[Part]:
    """Return a bicycle of two flat wheels, tubes, a saddle and a handlebar."""
    base, wheel, seat = rng.uniform([1.0, 0.32, 0.75], [1.3, 0.4, 1.0])
    return [
        cylinder(wheel, 0.06, (-base / 2, 0, wheel), Y),
        cylinder(wheel, 0.06, (base / 2, 0, wheel), Y),
        cylinder(0.04, base, (0, 0, wheel), X),
        cylinder(0.04, 0.75 * base, (0, 0, 0.85 * seat), X),
        cylinder(0.04, seat, (-0.2 * base, 0, seat / 2 + 0.1)),
        cylinder(0.04, seat, (0.45 * base, 0, seat / 2 + 0.25)),
        box((0.3, 0.15, 0.06), (-0.2 * base, 0, seat + 0.12)),
        cylinder(0.03, 0.6, (0.45 * base, 0, seat + 0.25), Y),
    ]


def desk(rng: np.random.Generator) -> list[Part]:
    """Return a desk: top, four legs, a chest of drawers under one side, a panel at the back."""
    width, depth, height = rng.uniform([1.3, 0.6, 0.65], [1.8, 0.9, 0.8])
    chest = rng.uniform(0.3, 0.45)
    return [
        box((width, depth, 0.06), (0, 0, 0)),
        *_legs(width, depth, height, 0.07),
        box((chest, 0.85 * depth, 0.6 * height), (width / 2 - 0.6 * chest, 0, -0.3 * height)),
        box((0.9 * width, 0.04, 0.35 * height), (0, -0.45 * depth, -0.2 * height)),
    ]


def hammer(rng: np.random.Generator) -> list[Part]:
    """Return a hammer: handle, head, and a claw that differs from the face."""
    length, head = rng.uniform([1.4, 0.5], [2.0, 0.8])
    return [
        cylinder(rng.uniform(0.06, 0.1), length, (0, 0, 0)),
        box((head, 0.2, 0.2), (0, 0, length / 2)),
        cylinder(0.16, 0.16, (head / 2 + 0.08, 0, length / 2), X),
        box((0.45, 0.14, 0.06), (-head / 2 - 0.2, 0, length / 2 + 0.05)),
    ]


#: How an object of each class is made. The x, y and z axes mean the same on all objects of a class.
CLASSES: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "chairs": chair,
    "mugs": mug,
    "cars": car,
    "computers": computer,
    "lamps": lamp,
    "beds": bed,
    "sofas": sofa,
    "bikes": bike,
    "desks": desk,
    "hammers": hammer,
}


def assembled_objects(kind: str, num: int, rng: np.random.Generator) -> tuple[Shape, ...]:
    """Return objects of a class of :data:`CLASSES` in one frame, each one mesh of parts that no edge connects."""
    return tuple(
        _assembled(CLASSES[kind](rng), f"{kind.removesuffix('s')}{i:02d}")
        for i in range(1, num + 1)
    )


def _assembled(parts: list[Part], name: str) -> Shape:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return Shape.from_arrays(
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)]),
        name=name,
    )


def _legs(width: float, depth: float, height: float, thick: float) -> list[Part]:
    return [
        box((thick, thick, height), (x * 0.46 * width, y * 0.46 * depth, -height / 2))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
