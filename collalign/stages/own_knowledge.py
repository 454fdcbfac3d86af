"""A caller's own descriptors, samples, poses and trust: checked, and brought to where the pipeline has its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from collalign.engine.job import table_of_values
from collalign.engine.records import MAX_INDEX
from collalign.options import ALL, AUTO, NEVER, AlignOptions, AlignSession
from collalign.products.named_frame import frame_origin, frame_rotation, without_names
from collalign.products.own import OF_PAIRS, Names, Own
from collalign.products.pair import Pair
from collalign.products.shapes import Constraints, Shapes
from collalign.stages.poses.agreement import SAME_POSE_RAD, resolve_pair, solve_again
from data_tools.arrays import (
    ORTHOGONAL_TOL,
    FloatArray,
    as_floats,
    as_indices,
    as_rotations,
    read_only,
)
from data_tools.embedding.sampling import OwnPoints
from data_tools.errors import InputError, OptionsError
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.names import by_known_names, known_names
from data_tools.notes import Note
from data_tools.options import MIN_POINTS, CleaningOptions
from data_tools.poses import AGREE_DEG, scales_of
from data_tools.rotations import nearest_orthogonal, rotation_angle_deg, rotation_angles


def with_known_names(own: Own, names: Sequence[str]) -> Own:
    """Return what is given by the names of the shapes, where it is by names that nearly agree.

    Parameters
    ----------
    own : Own
    names : sequence of str
        Of the collection's shapes.

    Raises
    ------
    InputError
        If a name is unknown, see :func:`data_tools.names.known_names`.
    """
    found: dict[str, Any] = {}
    for argument in ("invariants", "samples", "marks"):
        if isinstance(given := getattr(own, argument), Mapping):
            found[argument] = by_known_names(argument, given, names)
    for argument in OF_PAIRS:
        given = getattr(own, argument)
        called = known_names(argument, (name for pair in given for name in pair), names)
        found[argument] = {(called[a], called[b]): value for (a, b), value in given.items()}
    order = known_names("order", own.order, names)
    return replace(own, **found, order=tuple(order[name] for name in own.order))


def own_points(
    own: Own, files: Mapping[str, Origin], cleaning: CleaningOptions
) -> dict[str, OwnPoints]:
    """Return what is given of each shape, checked; nothing where all is left to the pipeline.

    Parameters
    ----------
    own : Own
    files : mapping of str to Path or Source
        The collection's shapes by name.
    cleaning : CleaningOptions
        How they are read.

    Raises
    ------
    InputError
        If a shape has none of what others have, or arrays are not what :class:`Own` asks for.
    """
    if callable(own.invariants):
        values = {
            name: own.invariants(read_shape(file, cleaning.as_stored, name=name))
            for name, file in files.items()
        }
    else:
        values = dict(own.invariants)
    rows, chosen = dict[str, FloatArray](), {}
    for argument, given in (("invariants", values), ("samples", own.samples)):
        if given and (missing := sorted(set(files) - set(given))):
            raise InputError(f"{argument}: every shape needs its own, {missing[0]!r} has none")
    for name in values:
        rows[name] = as_floats(values[name], f"invariants[{name}]", shape=(None, None))
    for name in own.samples:
        chosen[name] = as_indices(
            own.samples[name], f"samples[{name}]", upper=MAX_INDEX, shape=(None,)
        )
        if not MIN_POINTS <= len(chosen[name]) == len(set(chosen[name].tolist())):
            raise InputError(f"samples[{name}]: expected at least {MIN_POINTS} different vertices")
    for argument, sizes in (
        ("invariants", {name: found.shape[1] for name, found in rows.items()}),
        ("samples", {name: len(found) for name, found in chosen.items()}),
    ):
        if len(set(sizes.values())) > 1:
            few, many = (pick(sizes, key=lambda name: sizes[name]) for pick in (min, max))
            raise InputError(
                f"{argument}: {few} has {sizes[few]} columns or vertices, {many} has {sizes[many]}"
            )
    return {
        name: OwnPoints(
            samples=chosen.get(name), invariants=rows.get(name), weight=own.invariants_weight
        )
        for name in (files if rows or chosen else ())
    }


def with_own_samples(session: AlignSession, given: Mapping[str, OwnPoints]) -> AlignSession:
    """Return the session whose options say how many samples are given, if any are."""
    samples = next((one.samples for one in given.values()), None)
    if samples is None:
        return session
    sampling = replace(session.options.sampling, num_points=len(samples))
    return replace(session, options=replace(session.options, sampling=sampling))


def with_known_options(session: AlignSession, names: Sequence[str]) -> AlignSession:
    """Return the session whose reference and incomplete shapes are called like the shapes that nearly agree.

    Raises
    ------
    InputError
        If there is no shape of a name.
    """
    options = session.options
    if options.reference:
        found = known_names("reference", [options.reference], names)
        options = replace(options, reference=found[options.reference])
    if options.incomplete not in (ALL, AUTO, NEVER):
        asked = [name.strip() for name in options.incomplete.split(",") if name.strip()]
        found = known_names("incomplete", asked, names)
        options = replace(options, incomplete=",".join(found.values()))
    return replace(session, options=options)


def with_marks(session: AlignSession, own: Own) -> AlignSession:
    """Return the session whose reference is the shape with landmarks, and whose options need them no more.

    Raises
    ------
    InputError
        If several shapes have landmarks and none is the reference, or it lacks a landmark that is named.
    """
    options = session.options
    if own.marks and options.reference not in own.marks:
        if options.reference or len(own.marks) > 1:
            reference = (
                f"the reference, {options.reference!r}," if options.reference else "the reference"
            )
            raise InputError(
                f"marks: {reference} has no landmarks, {', '.join(own.marks)} has; name it as reference"
            )
        options = replace(options, reference=next(iter(own.marks)))
    marks = {
        label: as_floats(point, f"marks[{label}]", shape=(3,))
        for label, point in own.marks.get(options.reference, {}).items()
    }
    return replace(session, options=without_names(options, marks))


def given_constraints(
    shapes: Shapes,
    options: AlignOptions,
    own: Own,
    fixed: Mapping[str, ArrayLike],
    kept: Mapping[str, ArrayLike] = MappingProxyType({}),
) -> Constraints:
    """Return what stays and what is given of pairs, checked and by position, a pair's first shape before the other.

    Parameters
    ----------
    shapes : Shapes
    options : AlignOptions
    own : Own
    fixed : mapping of name to array_like (3, 3) or (4, 4)
        Rotations, or whole transforms, that a person decided: they stay and are certain.
    kept : mapping of name to array_like (3, 3) or (4, 4), optional
        The same of shapes that only stay where they were; what is fixed goes before.

    Raises
    ------
    InputError
        If there is no shape of a name, up and front are one direction, a transform is no similarity or scales where
        sizes stay, a given pose mirrors a shape and the options' group forbids that, or matched vertices are none of
        a file's, or on a line.
    OptionsError
        If directions are to turn a frame that poses set by hand fix, or there is an order, but nobody said that the
        shapes are scans.
    """
    if own.order and options.incomplete != ALL:
        raise OptionsError(
            "order: only scans of one object or room have an order in which they were taken; say incomplete=all"
        )
    for argument, names in (
        ("fixed", {*fixed}),
        ("kept", {*kept}),
        ("reference", {options.reference} - {""}),
    ):
        known_names(argument, names, shapes.names)
    by_hand, fixed = {*fixed}, {**kept, **fixed}
    at = {name: i for i, name in enumerate(shapes.names)}
    rotations, whole = dict(fixed), dict[str, FloatArray]()
    for name, pose in fixed.items():
        if np.shape(pose) == (4, 4):
            whole[name] = as_floats(pose, f"fixed[{name}]")
            scale = float(scales_of(whole[name]))
            if not scale or (whole[name][3] != (0.0, 0.0, 0.0, 1.0)).any():
                raise InputError(
                    f"fixed[{name}]: not the transform of a similarity, with a last row 0, 0, 0, 1"
                )
            if options.scaling == "rigid" and abs(scale - 1.0) > ORTHOGONAL_TOL:
                raise InputError(
                    f"fixed[{name}]: has a scale of {scale:.6g}, but sizes stay with scaling 'rigid'"
                )
            rotations[name] = whole[name][:3, :3] / scale
    candidates, weights = dict[tuple[int, int], FloatArray](), dict[tuple[int, int], float]()
    group = "SO" if options.group == "SO" else "O"
    proposed = [
        (pair, as_rotations(given, f"candidates[{', '.join(pair)}]", group=group).reshape(-1, 3, 3))
        for pair, given in sorted(own.candidates.items())
    ]
    vertices = cache(
        lambda name: (
            read_shape(shapes.files[at[name]], options.cleaning.as_stored, name=name).file_vertices
        )
    )
    for both, rows in sorted(own.correspondences.items()):
        if at.keys() >= {*both}:
            proposed.append((both, _pose_of_matches(both, rows, vertices, group)))
    for (a, b), poses in proposed:
        if a in at and b in at:  # else left out, with its reason
            pair, poses = (
                _ordered(at[a], at[b]),
                poses if at[a] < at[b] else poses.transpose(0, 2, 1),
            )
            candidates[pair] = np.concatenate([candidates.get(pair, np.empty((0, 3, 3))), poses])
    for (a, b), weight in own.pair_weights.items():
        if a in at and b in at:
            weights[_ordered(at[a], at[b])] = float(weight)
    if options.rotates_frame and by_hand and not kept:
        raise OptionsError(
            "up: poses set by hand fix the common frame, so it cannot be rotated; name an axis"
        )
    return Constraints(
        fixed={
            at[name]: as_rotations(pose, f"fixed[{name}]", dim=3)
            for name, pose in rotations.items()
        },
        fixed_transforms={at[name]: transform for name, transform in whole.items()},
        by_hand=frozenset(at[name] for name in by_hand),
        reference=at[options.reference] if options.reference else 0,
        candidates=candidates,
        weights=weights,
        order=tuple(at[name] for name in own.order if name in at),
        rotation=frame_rotation(options) if options.rotates_frame and not fixed else None,
        origin=None if whole else frame_origin(options),
    )


def with_own(
    session: AlignSession, shapes: Shapes, pairs: list[Pair], constraints: Constraints
) -> list[Pair]:
    """Return the pairs with the caller's weights and candidates.

    Each pose goes to the nearest local minimum of the pair's energy, and what the pair has already is not added.
    """
    weights, own = constraints.weights, constraints.candidates
    pairs = [replace(pair, weight=weights.get((pair.target, pair.source), 1.0)) for pair in pairs]
    candidates = [
        (e, pose)
        for e, pair in enumerate(pairs)
        for pose in own.get((pair.target, pair.source), ())
    ]
    if not candidates:
        return pairs
    starts = np.stack([pose for _, pose in candidates])
    with table_of_values(shapes.samples) as table:
        found = solve_again(session, [pairs[e] for e, _ in candidates], starts, table, resolve_pair)
    for (e, _), pose in zip(candidates, found, strict=True):
        pair = pairs[e]
        if rotation_angles(pair.rotations, pose["rotations"][0]).min() > SAME_POSE_RAD:
            order = np.argsort(np.append(pair.energies, pose["energies"]), kind="stable")
            rotations, maps, energies, mismatches = (
                read_only(np.concatenate([getattr(pair, name), pose[name]])[order])
                for name in ("rotations", "maps", "energies", "mismatches")
            )
            pairs[e] = replace(
                pair, rotations=rotations, maps=maps, energies=energies, mismatches=mismatches
            )
    return pairs


def own_notes(
    own: Own, points: Mapping[str, OwnPoints], known: Constraints, rotations: FloatArray
) -> tuple[Note, ...]:
    """Return the note on what the caller gave and what became of it at the poses (N, 3, 3); none for nothing."""
    said, some = dict[str, float](), next(iter(points.values()), None)
    if some is not None and some.invariants is not None:
        said |= {"num_invariants": some.invariants.shape[1], "weight": float(some.weight)}
    if some is not None and some.samples is not None:
        said["num_samples"] = len(some.samples)
    if known.candidates:
        near = sum(
            bool((rotation_angle_deg(poses, rotations[i].T @ rotations[j]) <= AGREE_DEG).any())
            for (i, j), poses in known.candidates.items()
        )
        said |= {"num_posed": len(known.candidates), "num_near": near, "near_deg": AGREE_DEG}
    if own.pair_weights:
        said |= {
            "num_weights": len(known.weights),
            "num_zero": list(known.weights.values()).count(0.0),
        }
    if known.order:
        said["num_ordered"] = len(known.order)
    return (Note("given", values=said),) if said else ()


def _pose_of_matches(
    pair: Names, rows: ArrayLike, vertices: Callable[[str], FloatArray], group: str
) -> FloatArray:
    """Return the rotation that takes matched vertices of the second shape to those of the first, shape (1, 3, 3).

    It mirrors only where the group allows it and the matches, being in no plane, can tell.
    """
    called = f"correspondences[{', '.join(pair)}]"
    matches = as_indices(rows, called, upper=MAX_INDEX, shape=(None, 2))
    points = []
    for name, chosen in zip(pair, matches.T, strict=True):
        points.append(
            vertices(name)[as_indices(chosen, f"{called}, of {name}", upper=len(vertices(name)))]
        )
    matched = np.stack(points)[:, np.isfinite(points).all(axis=(0, 2))]
    centred = matched - matched.mean(axis=1, keepdims=True) if matched.size else matched
    covariance = centred[0].T @ centred[1]
    rank = np.linalg.matrix_rank(covariance, rtol=1e-9)
    if rank < 2:
        raise InputError(f"{called}: expected three or more matches that do not lie on a line")
    return nearest_orthogonal(covariance, determinant=1 if group == "SO" or rank == 2 else None)[
        None
    ]


def _ordered(i: int, j: int) -> tuple[int, int]:
    return min(i, j), max(i, j)
