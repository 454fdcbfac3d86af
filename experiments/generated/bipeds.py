"""Generated bodies on two legs, of several kinds, with the true map between any two of them.

All are one template: an implicit body with feet, calves, buttocks, a chest, a face, thumbs and a tail. Its bones are
stretched, thickened and bent (linear blend skinning with affine bones). Knees, elbows and the trunk bend as those of
animals do. Each body is then decimated by itself, so that no two share their vertices. The truth is where the points
of the template lie.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from data_tools.arrays import FloatArray, IntArray
from data_tools.surface.shape import Shape

#: Grid spacing of the template, how far its parts melt into each other, and how far a bone pulls at others' skin.
_CELL, _BLEND, _PULL = 0.018, 0.02, 0.025
#: Triangles of a body.
_NUM_FACES = 7000
#: A bone of the template: its parent, its start and its end. x is in front, y left, z up.
_BONES: dict[str, tuple[str, tuple[float, ...], tuple[float, ...]]] = {
    "pelvis": ("", (0, 0, 0.95), (0, 0, 1.1)),
    "chest": ("pelvis", (0, 0, 1.1), (0, 0, 1.45)),
    "head": ("chest", (0, 0, 1.48), (0, 0, 1.72)),
    "face": ("head", (0.05, 0, 1.6), (0.13, 0, 1.58)),
    "tail": ("pelvis", (-0.09, 0, 0.95), (-0.35, 0, 0.8)),
    "tip": ("tail", (-0.35, 0, 0.8), (-0.6, 0, 0.7)),
    "upper arm": ("chest", (0, 0.19, 1.43), (0, 0.46, 1.43)),
    "forearm": ("upper arm", (0, 0.46, 1.43), (0, 0.7, 1.43)),
    "hand": ("forearm", (0, 0.7, 1.43), (0, 0.87, 1.43)),
    "thigh": ("pelvis", (0, 0.11, 0.92), (0, 0.12, 0.5)),
    "shin": ("thigh", (0, 0.12, 0.5), (0, 0.12, 0.08)),
    "foot": ("shin", (0, 0.12, 0.08), (0.2, 0.12, 0.03)),
}
#: Parts of the template: bone, two ends, radius. Those that lie left have a mirror image.
_PARTS: tuple[tuple[str, tuple[float, ...], tuple[float, ...], float], ...] = (
    ("pelvis", (0, -0.06, 0.98), (0, 0.06, 0.98), 0.12),
    ("pelvis", (0, 0, 1.0), (0, 0, 1.12), 0.12),
    ("pelvis", (-0.07, 0.07, 0.93), (-0.07, 0.08, 0.9), 0.085),
    ("chest", (0, 0, 1.12), (0, 0, 1.3), 0.125),
    ("chest", (0, -0.1, 1.38), (0, 0.1, 1.38), 0.1),
    ("chest", (0.06, 0.07, 1.32), (0.06, 0.08, 1.34), 0.075),
    ("chest", (0, 0, 1.42), (0, 0, 1.5), 0.055),
    ("head", (0.0, 0, 1.6), (-0.015, 0, 1.65), 0.1),
    ("face", (0.05, 0, 1.58), (0.115, 0, 1.57), 0.045),
    ("face", (0.06, 0, 1.54), (0.075, 0, 1.525), 0.045),
    ("tail", (-0.09, 0, 0.95), (-0.35, 0, 0.8), 0.05),
    ("tip", (-0.35, 0, 0.8), (-0.6, 0, 0.7), 0.035),
    ("upper arm", (0, 0.15, 1.43), (0, 0.46, 1.43), 0.05),
    ("forearm", (0, 0.46, 1.43), (0, 0.58, 1.43), 0.045),
    ("forearm", (0, 0.58, 1.43), (0, 0.7, 1.43), 0.035),
    ("hand", (0.01, 0.74, 1.43), (0.01, 0.86, 1.425), 0.033),
    ("hand", (-0.02, 0.74, 1.43), (-0.02, 0.84, 1.425), 0.03),
    ("hand", (0.03, 0.73, 1.425), (0.085, 0.79, 1.42), 0.02),
    ("thigh", (0, 0.1, 0.9), (0.01, 0.12, 0.5), 0.075),
    ("shin", (0, 0.12, 0.5), (0, 0.12, 0.08), 0.045),
    ("shin", (-0.03, 0.12, 0.42), (-0.02, 0.12, 0.3), 0.05),
    ("foot", (-0.04, 0.12, 0.04), (0.0, 0.12, 0.06), 0.04),
    ("foot", (0, 0.12, 0.04), (0.17, 0.13, 0.025), 0.035),
)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of body: how long and how thick its bones are, relative to the template, and how far it stoops.

    Attributes
    ----------
    long, thick : mapping of str to float
        By bone; 1 where nothing is said.
    stoop_deg : float
        How far the trunk leans forwards; the head looks ahead again.
    """

    long: Mapping[str, float]
    thick: Mapping[str, float]
    stoop_deg: float = 0.0


def _kind(
    *,
    arm: float = 1.0,
    leg: float = 1.0,
    trunk: float = 1.0,
    head: float = 1.0,
    face: float = 1.0,
    foot: float = 1.0,
    tail: float = 0.1,
    girth: float = 1.0,
    limbs: float = 1.0,
    stoop_deg: float = 0.0,
) -> Kind:
    """Return a kind by the size of its parts; hands are as large as feet."""
    arms, legs = dict.fromkeys(("upper arm", "forearm"), arm), dict.fromkeys(("thigh", "shin"), leg)
    ends = {"hand": foot, "foot": foot, "head": head, "face": face}
    return Kind(
        long=arms | legs | ends | {"chest": trunk, "pelvis": trunk, "tail": tail, "tip": tail},
        thick=dict.fromkeys((*arms, *legs), limbs)
        | ends
        | {"face": head, "chest": girth, "pelvis": girth, "tail": tail**0.3, "tip": tail**0.3},
        stoop_deg=stoop_deg,
    )


#: Kinds that constants may be chosen on.
KINDS = {
    "person": _kind(),
    "child": _kind(arm=0.8, leg=0.75, trunk=0.9, head=1.3, limbs=1.1),
    "ape": _kind(arm=1.35, leg=0.7, girth=1.25, limbs=1.25, face=1.8, stoop_deg=25),
    "armadillo": _kind(
        arm=0.8, leg=0.7, girth=1.2, limbs=1.3, head=1.2, face=2.2, foot=1.4, tail=1, stoop_deg=10
    ),
}
#: Kinds that are kept apart: nothing is chosen on them.
KINDS_APART = {
    "gibbon": _kind(arm=1.7, leg=0.8, trunk=0.85, limbs=0.8, face=1.4, foot=1.2, stoop_deg=15),
    "kangaroo": _kind(
        arm=0.6, leg=1.1, girth=1.1, head=0.8, face=2, foot=1.6, tail=1.3, stoop_deg=35
    ),
    "giant": _kind(arm=1.1, girth=1.4, limbs=1.5, head=0.85),
    "elf": _kind(arm=1.1, leg=1.2, girth=0.8, limbs=0.75, head=0.95, foot=0.9),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Biped:
    """A generated body.

    Attributes
    ----------
    shape : Shape
    places : ndarray of int, shape (t,)
        The vertex of the body at each point of the template.
    to_template : ndarray of int, shape (v,)
        The point of the template at each vertex of the body.
    """

    shape: Shape
    places: IntArray
    to_template: IntArray

    def true_map_from(self, source: Biped) -> IntArray:
        """Return the vertex of this body for each vertex of another one, shape (v_source,)."""
        return self.places[source.to_template]


def biped(kind: Kind, rng: np.random.Generator, name: str = "biped") -> Biped:
    """Return a body of a kind, its size a little off, in a random posture and a random pose."""
    import fast_simplification

    points, faces, weights = _template()
    placed = _skinned(points, weights, kind, _posture(kind, rng), rng)
    placed = Rotation.random(random_state=rng).apply(placed)
    vertices, triangles = fast_simplification.simplify(
        placed.astype(np.float32),
        faces.astype(np.int32),
        target_reduction=1 - _NUM_FACES / len(faces),
    )
    shape = Shape.from_arrays(
        np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int64), name=name
    )
    places = cKDTree(shape.vertices).query(placed)[1]
    return Biped(shape=shape, places=places, to_template=cKDTree(placed).query(shape.vertices)[1])


def template_points() -> FloatArray:
    """Return the points of the template, shape (t, 3); x is in front, y left, z up."""
    return _template()[0]


def _posture(kind: Kind, rng: np.random.Generator) -> dict[str, Rotation]:
    """Return how each bone turns against its parent: each joint as far as it does on animals, and no other way."""

    def drawn(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    bend = kind.stoop_deg + drawn(-5, 30)
    turns = {
        "pelvis": Rotation.from_euler("y", 0.3 * bend, degrees=True),
        "chest": Rotation.from_euler(
            "yxz", [0.7 * bend, drawn(-10, 10), drawn(-20, 20)], degrees=True
        ),
        "head": Rotation.from_euler(
            "yz", [drawn(-10, 15) - 0.8 * bend, drawn(-30, 30)], degrees=True
        ),
        "tail": Rotation.from_euler("yz", [drawn(-20, 30), drawn(-30, 30)], degrees=True),
        "tip": Rotation.from_euler("yz", [drawn(-10, 30), drawn(-30, 30)], degrees=True),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        down, forwards, elbow = drawn(-20, 75), drawn(-15, 60), drawn(5, 100)
        swing, apart, knee = drawn(-20, 70), drawn(0, 20), drawn(5, 80)
        turns |= {
            f"{side} upper arm": Rotation.from_euler("x", -sign * down, degrees=True)
            * Rotation.from_euler("z", -sign * forwards, degrees=True),
            f"{side} forearm": Rotation.from_euler("z", -sign * elbow, degrees=True),
            f"{side} hand": Rotation.from_euler("x", -sign * drawn(-20, 20), degrees=True),
            f"{side} thigh": Rotation.from_euler("yx", [-swing, sign * apart], degrees=True),
            f"{side} shin": Rotation.from_euler("y", knee, degrees=True),
            f"{side} foot": Rotation.from_euler("y", drawn(-20, 25), degrees=True),
        }
    return turns


def _skinned(
    points: FloatArray,
    weights: FloatArray,
    kind: Kind,
    posture: Mapping[str, Rotation],
    rng: np.random.Generator,
) -> FloatArray:
    """Return where the template's points lie, shape (t, 3)."""
    skeleton, sizes = _skeleton(), {bone: rng.uniform(0.93, 1.07, 2) for bone in _BONES}
    turned: dict[str, FloatArray] = {}
    bent: dict[str, FloatArray] = {}
    ends: dict[str, FloatArray] = {}
    placed = np.zeros_like(points)
    for column, (name, (parent, start, end)) in enumerate(skeleton.items()):
        bone = name.removeprefix("left ").removeprefix("right ")
        long, thick = sizes[bone] * (kind.long.get(bone, 1.0), kind.thick.get(bone, 1.0))
        axis = (end - start) / np.linalg.norm(end - start)
        own = posture[name].as_matrix() if name in posture else np.eye(3)
        turned[name] = turned[parent] @ own if parent else own
        bent[name] = turned[name] @ (thick * np.eye(3) + (long - thick) * np.outer(axis, axis))
        ends[name] = (
            start if not parent else ends[parent] + bent[parent] @ (start - skeleton[parent][1])
        )
        placed += weights[:, column : column + 1] * ((points - start) @ bent[name].T + ends[name])
    return placed


def _skeleton() -> dict[str, tuple[str, FloatArray, FloatArray]]:
    """Return all bones, parents first: of limbs one left and one right."""
    found: dict[str, tuple[str, FloatArray, FloatArray]] = {}
    for name, (parent, start, end) in _BONES.items():
        ends = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
        if ends[0][1] == 0:
            found[name] = (parent, *ends)
            continue
        for side, sign in (("left", 1.0), ("right", -1.0)):
            of = f"{side} {parent}" if _BONES[parent][1][1] else parent
            at_side = np.array([1.0, sign, 1.0])
            found[f"{side} {name}"] = (of, ends[0] * at_side, ends[1] * at_side)
    return found


@cache
def _template() -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the template's points (t, 3), its triangles, and how far each bone moves each point, (t, bones)."""
    from skimage.measure import marching_cubes

    low, high = np.array([-0.75, -1.0, -0.1]), np.array([0.4, 1.0, 1.85])
    axes = [np.arange(a, b, _CELL) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    near = np.zeros(grid.shape[:3])
    for _, a, b, radius in _parts():
        reach = radius + 12.0 * _BLEND  # beyond it a part counts for less than e^-12
        first = np.floor((np.minimum(a, b) - reach - low) / _CELL).astype(int)
        last = np.ceil((np.maximum(a, b) + reach - low) / _CELL).astype(int)
        box = tuple(slice(max(i, 0), max(j, 0)) for i, j in zip(first, last, strict=True))
        near[box] += np.exp(-(_distance(grid[box], a, b) - radius) / _BLEND)
    vertices, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        np.log(np.maximum(near, 1e-30)), 0.0, gradient_direction="ascent"
    )
    points = vertices * _CELL + low
    names = list(_skeleton())
    pulls = np.zeros((len(points), len(names)))
    for bone, a, b, radius in _parts():
        pulls[:, names.index(bone)] += np.exp(-(_distance(points, a, b) - radius) / _PULL)
    return points, faces.astype(np.int64), pulls / pulls.sum(axis=1, keepdims=True)


def _parts() -> list[tuple[str, FloatArray, FloatArray, float]]:
    """Return all parts, those of the right side included."""
    found = []
    for bone, start, end, radius in _PARTS:
        ends = np.array([start, end], dtype=np.float64)
        is_sided = ends[0][1] > 0
        limb = is_sided and bool(_BONES[bone][1][1])
        found.append((f"left {bone}" if limb else bone, *ends, radius))
        if is_sided:
            found.append((f"right {bone}" if limb else bone, *(ends * [1.0, -1.0, 1.0]), radius))
    return found


def _distance(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return how far points (..., 3) are from a segment."""
    along = end - start
    share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[..., None] * along, axis=-1))
