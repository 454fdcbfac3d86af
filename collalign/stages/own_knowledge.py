"""A caller's own descriptors, samples, poses and trust: checked, and brought to where the pipeline has its own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from collalign.engine.jobs.job import table_of_values
from collalign.engine.store.typed import MAX_INDEX
from collalign.options import AlignSession
from collalign.products.own import Own
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints, Shapes
from collalign.stages.poses.agreement import SAME_POSE_RAD, resolve_pair, solve_again
from data_tools.arrays import FloatArray, as_floats, as_indices, as_rotations, read_only
from data_tools.checks import meant
from data_tools.embedding.own_points import OwnPoints
from data_tools.errors import InputError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import AS_STORED, MIN_POINTS
from data_tools.poses import AGREE_DEG
from data_tools.rotations import rotation_angle_deg, rotation_angles


def own_points(own: Own, files: Mapping[str, Origin]) -> dict[str, OwnPoints]:
    """Return what is given of each shape, checked; nothing where all is left to the pipeline.

    Parameters
    ----------
    own : Own
    files : mapping of str to Path or Source
        The collection's shapes by name.

    Raises
    ------
    InputError
        If a name is unknown or missing, or arrays are not what :class:`Own` asks for.
    """
    for argument in ("candidates", "pair_weights"):
        _refuse_unknown(argument, {name for pair in getattr(own, argument) for name in pair}, files)
    if callable(own.invariants):
        values = {name: own.invariants(read_shape(file, AS_STORED, name=name)) for name, file in files.items()}
    else:
        values = dict(own.invariants)
    rows, chosen = dict[str, FloatArray](), {}
    for argument, given in (("invariants", values), ("samples", own.samples)):
        _refuse_unknown(argument, given, files)
        if given and (missing := sorted(set(files) - set(given))):
            raise InputError(f"{argument}: every shape needs its own, {missing[0]!r} has none")
    for name in values:
        rows[name] = as_floats(values[name], f"invariants[{name}]", shape=(None, None))
    for name in own.samples:
        chosen[name] = as_indices(own.samples[name], f"samples[{name}]", upper=MAX_INDEX, shape=(None,))
        if not MIN_POINTS <= len(chosen[name]) == len(set(chosen[name].tolist())):
            raise InputError(f"samples[{name}]: expected at least {MIN_POINTS} different vertices")
    for argument, sizes in (
        ("invariants", {name: found.shape[1] for name, found in rows.items()}),
        ("samples", {name: len(found) for name, found in chosen.items()}),
    ):
        if len(set(sizes.values())) > 1:
            few, many = (pick(sizes, key=lambda name: sizes[name]) for pick in (min, max))
            raise InputError(f"{argument}: {few} has {sizes[few]} columns or vertices, {many} has {sizes[many]}")
    return {
        name: OwnPoints(samples=chosen.get(name), invariants=rows.get(name), weight=own.invariants_weight)
        for name in (files if rows or chosen else ())
    }


def with_own_pairs(constraints: Constraints, own: Own, shapes: Shapes, group: str) -> Constraints:
    """Return the constraints with what is given of pairs, by position, the first shape of a pair before the other.

    Raises
    ------
    InputError
        If a pose mirrors a shape and ``group`` forbids that.
    """
    at = {name: i for i, name in enumerate(shapes.names)}
    candidates, weights = dict[tuple[int, int], FloatArray](), dict[tuple[int, int], float]()
    for (a, b), given in sorted(own.candidates.items()):
        poses = as_rotations(given, f"candidates[{a}, {b}]", group="SO" if group == "SO" else "O").reshape(-1, 3, 3)
        if a in at and b in at:  # else left out, with its reason
            pair, poses = _ordered(at[a], at[b]), poses if at[a] < at[b] else poses.transpose(0, 2, 1)
            candidates[pair] = np.concatenate([candidates.get(pair, np.empty((0, 3, 3))), poses])
    for (a, b), weight in own.pair_weights.items():
        if a in at and b in at:
            weights[_ordered(at[a], at[b])] = float(weight)
    return replace(constraints, candidates=candidates, weights=weights)


def with_own(session: AlignSession, shapes: Shapes, pairs: list[Pair], constraints: Constraints) -> list[Pair]:
    """Return the pairs with the caller's weights and candidates.

    Each pose goes to the nearest local minimum of the pair's energy, and what the pair has already is not added.
    """
    weights, own = constraints.weights, constraints.candidates
    pairs = [replace(pair, weight=weights.get((pair.target, pair.source), 1.0)) for pair in pairs]
    asked = [(e, pose) for e, pair in enumerate(pairs) for pose in own.get((pair.target, pair.source), ())]
    if not asked:
        return pairs
    starts = np.stack([pose for _, pose in asked])
    with table_of_values(shapes.samples) as table:
        found = solve_again(session, [pairs[e] for e, _ in asked], starts, table, resolve_pair)
    for (e, _), pose in zip(asked, found, strict=True):
        pair = pairs[e]
        if rotation_angles(pair.rotations, pose["rotations"][0]).min() > SAME_POSE_RAD:
            order = np.argsort(np.append(pair.energies, pose["energies"]), kind="stable")
            rotations, maps, energies, gaps = (
                read_only(np.concatenate([getattr(pair, name), pose[name]])[order])
                for name in ("rotations", "maps", "energies", "gaps")
            )
            pairs[e] = replace(pair, rotations=rotations, maps=maps, energies=energies, gaps=gaps)
    return pairs


def own_note(own: Own, points: Mapping[str, OwnPoints], known: Constraints, rotations: FloatArray) -> str:
    """Return the sentence that says what the caller gave and what became of it; empty for nothing."""
    words, some = [], next(iter(points.values()), None)
    if some is not None and some.invariants is not None:
        words.append(f"invariants ({some.invariants.shape[1]} columns of weight {some.weight:g})")
    if some is not None and some.samples is not None:
        words.append(f"samples ({len(some.samples)} a shape)")
    if own.candidates:
        near = sum(
            bool((rotation_angle_deg(poses, rotations[i].T @ rotations[j]) <= AGREE_DEG).any())
            for (i, j), poses in known.candidates.items()
        )
        words.append(f"poses of {len(known.candidates)} pairs, {near} within {AGREE_DEG:g} deg of the result")
    if own.pair_weights:
        words.append(f"weights of {len(known.weights)} pairs, {list(known.weights.values()).count(0.0)} left out")
    return f"Given by the caller: {'; '.join(words)}." if words else ""


def _ordered(i: int, j: int) -> tuple[int, int]:
    return min(i, j), max(i, j)


def _refuse_unknown(argument: str, names: Iterable[str], known: Iterable[str]) -> None:
    unknown = sorted(set(names) - set(known), key=str)
    if unknown:
        raise InputError(f"{argument}: no shape is called {unknown[0]!r}{meant(unknown[0], known)}")
