"""Align a collection: files, samples, pairs, synchronization, maps, as in section 6.3 of Maron et al. (2016)."""

from __future__ import annotations

import platform
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version

import numpy as np
from numpy.typing import ArrayLike

from collalign.collection import AlignedCollection
from collalign.engine.options import RunOptions
from collalign.engine.session import ProgressFactory, Session, progress_display
from collalign.engine.store.layout import FINISHED
from collalign.options import AUTO, AlignOptions, AlignSession
from collalign.products.collection import ConsistentMaps, RunRecord
from collalign.products.pair import FormerPairs
from collalign.products.shapes import Constraints, Shapes
from collalign.stages.chirality.pilot import decide_group
from collalign.stages.deformation.solve import map_vertices, vertex_notes
from collalign.stages.evidence.decide import wants_maps
from collalign.stages.evidence.rivals import try_rivals
from collalign.stages.evidence.weigh import weigh_pairs
from collalign.stages.incomplete.add import with_incomplete
from collalign.stages.incomplete.detect import MIN_SHAPES, find_incomplete, told_incomplete
from collalign.stages.incomplete.grow import align_scans
from collalign.stages.pairs.choose import choose_pairs, describe_shapes, grow_pairs
from collalign.stages.pairs.match import match_pairs, num_reused_pairs
from collalign.stages.poses.agreement import resolve_pairs, with_common_match
from collalign.stages.poses.frame import fix_frame
from collalign.stages.poses.parts import join_parts, split_shapes
from collalign.stages.poses.placement import common_labels, common_positions, in_label_order, place_and_scale
from collalign.stages.poses.refinement import refine_poses
from collalign.stages.poses.synchronize import synchronize_shapes
from collalign.stages.proofs import certify_pairs, contradictions
from collalign.stages.shapes import prepare_shapes
from collalign.stages.trial import rest_s
from collalign.stages.trust.assess import gather_trust, with_trust
from collalign.stages.trust.words import trust_notes
from data_tools.arrays import FloatArray, as_rotations, read_only
from data_tools.errors import CollectionError, InputError
from data_tools.io.files import readable_name
from data_tools.io.objects import ShapesLike, list_shapes
from data_tools.io.shapes import FolderListing
from data_tools.threads import one_blas_thread

#: How often incomplete shapes are looked for among those that are left.
MAX_ROUNDS = 3
_LIBRARIES = ("collalign", "numpy", "scipy", "trimesh", "potpourri3d", "robust-laplacian", "joblib")


@one_blas_thread()
def align_collection(
    shapes: ShapesLike,
    *,
    options: AlignOptions | None = None,
    run: RunOptions | None = None,
    fixed: Mapping[str, ArrayLike] | None = None,
    progress: ProgressFactory | bool = True,
) -> AlignedCollection:
    """Align shapes consistently: one rigid pose for each, and maps between all of them.

    Parameters
    ----------
    shapes : str, Path, iterable or mapping of name to shape
        A folder of meshes (PLY, OFF, OBJ, STL, GLB) and point clouds (PLY, PCD, XYZ, TXT, CSV, NPZ), or several of:
        files, arrays (n, 3), pairs (V, F), trimesh and Open3D objects.
    options : AlignOptions, optional
        What decides the result.
    run : RunOptions, optional
        Processes, store, limits: how the work is done.
    fixed : mapping of name to array_like (3, 3), optional
        ``R_common_shape`` of shapes whose orientation a person has decided; they come out exactly so.
    progress : bool or callable
        A bar per stage in terminals and notebooks; False is silent; a callable makes another display.

    Returns
    -------
    AlignedCollection
        ``save(folder)`` writes it.

    Raises
    ------
    InputError
        If there are no shapes, or ``fixed`` or ``options.reference`` names a shape that is not there.
    CollectionError
        If fewer than two shapes, or no pair, could be used.
    StoreError
        If the store is damaged or in use.

    Examples
    --------
    >>> points = np.random.default_rng(0).random((40, 3))
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> aligned = collalign.align_collection({"still": points, "turned": points @ quarter}, progress=False)
    >>> bool(np.allclose(aligned.rotations[1], quarter, atol=1e-3))
    True
    """
    listing = list_shapes(shapes)
    with Session.open(options or AlignOptions(), run or RunOptions(), progress_display(progress)) as session:
        return align_listing(session, listing, fixed=fixed or {})


@one_blas_thread()
def align_listing(
    session: AlignSession,
    listing: FolderListing,
    *,
    fixed: Mapping[str, ArrayLike],
    fixed_transforms: Mapping[str, FloatArray] | None = None,
    former: FormerPairs | None = None,
    incomplete: Collection[str] = (),
) -> AlignedCollection:
    """Align listed files; :func:`align_collection` and :func:`collalign.extend.add_to_collection` both end here.

    Parameters
    ----------
    session : Session
    listing : FolderListing
    fixed : mapping of name to array_like (3, 3)
        Rotations that stay.
    fixed_transforms : mapping of name to ndarray (4, 4), optional
        Whole transforms that stay, of shapes whose rotation is fixed as well.
    former : FormerPairs, optional
        Pairs of an earlier run.
    incomplete : collection of str
        Shapes that an earlier run found to be incomplete.
    """
    times_s = dict[str, float]()
    with _stage(session, times_s, "shapes"):
        shapes = prepare_shapes(session, listing)
        constraints = _constraints(shapes, session.options, fixed, fixed_transforms or {})
    skipped = tuple(readable_name(path) for path in listing.skipped)
    missing = told_incomplete(session.options, shapes.names, {*incomplete} & {*shapes.names})
    if len(missing) == len(shapes.names):
        outline = _align_shapes(session, shapes, constraints, times_s, former)
        scans = align_scans(_with_group(session, outline.group), shapes, outline, missing, constraints)
        session.enter(FINISHED)
        return replace(scans, skipped=skipped)
    aligned = _align_others(session, shapes, constraints, times_s, missing, former)
    if not missing and session.options.incomplete == AUTO and session.options.clusters == 1:
        missing, aligned = _without_found(session, shapes, constraints, times_s, aligned, former)
    if missing:
        decided = _with_group(session, aligned.group)
        aligned = with_incomplete(decided, shapes, aligned, missing, constraints)
    session.enter(FINISHED)
    return replace(aligned, skipped=skipped)


def _with_group(session: AlignSession, group: str) -> AlignSession:
    """Return the session with the group that was decided."""
    return session.with_options(replace(session.options, group="O" if group == "O" else "SO"))


def _without_found(
    session: AlignSession,
    shapes: Shapes,
    constraints: Constraints,
    times_s: dict[str, float],
    aligned: AlignedCollection,
    former: FormerPairs | None,
) -> tuple[dict[int, str], AlignedCollection]:
    """Return the shapes that turn out to be incomplete, and the others aligned without them; in rounds.

    Incomplete shapes among complete ones may spoil poses, and so hide others.
    """
    missing: dict[int, str] = {}
    for _ in range(MAX_ROUNDS):
        kept = [i for i in range(len(shapes.names)) if i not in missing]
        shown = session.alone("incomplete shapes", len(kept))
        with _stage(session, times_s, "incomplete shapes"), shown as advance:
            found = find_incomplete(shapes.some(kept).samples, aligned, advance)
        fresh = {kept[n]: reason for n, reason in found.items() if kept[n] not in constraints.fixed}
        if not fresh or len(kept) - len(fresh) < MIN_SHAPES:
            break
        missing |= fresh
        aligned = _align_others(session, shapes, constraints, times_s, missing, former)
    return missing, aligned


def _align_others(
    session: AlignSession,
    shapes: Shapes,
    constraints: Constraints,
    times_s: dict[str, float],
    missing: Mapping[int, str],
    former: FormerPairs | None,
) -> AlignedCollection:
    """Align the shapes that are not incomplete."""
    if not missing:
        return _align_shapes(session, shapes, constraints, times_s, former)
    kept = [i for i in range(len(shapes.names)) if i not in missing]
    if len(kept) < 2:
        raise CollectionError(
            f"{len(kept)} complete shapes: at least two are needed to pose {len(missing)} incomplete ones on"
        )
    if session.options.reference and constraints.reference in missing:
        raise InputError(f"reference: {session.options.reference!r} is incomplete; choose a complete shape")
    some = former and former.some(kept)
    return _align_shapes(session, shapes.some(kept), constraints.some(kept), times_s, some)


def _align_shapes(
    session: AlignSession,
    shapes: Shapes,
    constraints: Constraints,
    times_s: dict[str, float],
    former: FormerPairs | None,
) -> AlignedCollection:
    """Align complete shapes; the steps are those of section 6.3 of Maron et al. (2016)."""
    asked = session.options
    with _stage(session, times_s, "pairs"):
        descriptors = describe_shapes(shapes)
        edges = choose_pairs(session, shapes, descriptors, former)
        choice = decide_group(
            session, shapes, descriptors, edges, former=former, any_mirrored=constraints.any_mirrored
        )
        session, notes = session.with_options(replace(asked, group=choice.group)), [choice.note]
        pairs, failed = match_pairs(session, shapes, edges)
        pairs, failed, solution = grow_pairs(session, shapes, descriptors, edges, pairs, failed)
    if asked.certify:
        with _stage(session, times_s, "proofs"):
            pairs, solution, report = certify_pairs(session, shapes, pairs, solution)
            notes.append(str(report))
    search_gain = None
    if wants_maps(session.options, pairs):
        with _stage(session, times_s, "maps"):
            search = try_rivals(session, shapes, weigh_pairs(session, shapes, pairs))
            pairs, solution, search_gain = search.pairs, search.solution, search.gain
    options, samples = session.options, shapes.samples
    if session.progress is not None:
        session = session.expecting(rest_s(session, shapes, pairs))
    with _stage(session, times_s, "synchronization"):
        with session.alone("synchronization"):
            parts, linked = split_shapes(options, samples, pairs)
            first = synchronize_shapes(options, samples, linked, constraints, known=solution if not parts else None)
        matched, (linked, solution) = linked, resolve_pairs(session, samples, linked, first, constraints)
        pairs, solution = join_parts(options, parts, pairs, linked, solution, constraints)
        rotations = refine_poses(session, samples, pairs, solution, constraints)
        with session.alone("common matches"):
            rotations, solution = fix_frame(options, samples, rotations, solution, constraints)
            pairs = with_common_match(samples, pairs, solution, rotations)
            notes.extend(contradictions(shapes.names, pairs, rotations))
            labels = common_labels(samples, pairs, rotations)
        transforms = place_and_scale(samples, rotations, labels, options.scaling, fixed=constraints.fixed_transforms)
    trust = None
    if options.synchronization == "robust":
        with _stage(session, times_s, "confidence"):
            trust = gather_trust(session, samples, matched, rotations, solution.components)
            solution = with_trust(solution, trust, constraints)
            notes.extend(trust_notes(shapes.names, trust, solution.confidence, first, rotations, constraints.fixed))
    vertices = None
    if options.deformable:
        with _stage(session, times_s, "vertices"):
            vertices = map_vertices(session, shapes, pairs, rotations)
            notes.extend(vertex_notes(vertices))
    record = RunRecord(
        times_s=times_s,
        versions={"python": platform.python_version()} | {name: version(name) for name in _LIBRARIES},
        num_reused=session.num_reused("shapes", shapes.keys) + num_reused_pairs(session, shapes, pairs),
    )
    positions = common_positions(samples, transforms)
    return AlignedCollection(
        names=shapes.names,
        files=shapes.files,
        digests=shapes.digests,
        transforms=read_only(transforms),
        rotations=read_only(rotations),
        reflected=read_only(np.linalg.det(rotations) < 0),
        confidence=solution.confidence,
        samples=tuple(item.vertex_indices for item in samples),
        positions=read_only(positions),
        coordinates=read_only(np.stack([item.coordinates for item in samples])),
        invariants=read_only(np.stack([item.invariants for item in samples])),
        maps=ConsistentMaps(names=shapes.names, labels=read_only(labels), vertices=vertices),
        consensus=read_only(in_label_order(positions, labels).mean(axis=0)),
        pairs=tuple(pairs),
        alternatives=solution.alternatives,
        parts=solution.parts,
        excluded=(*shapes.excluded, *failed),
        skipped=(),
        notes=(
            *solution.warnings,
            *shapes.notes,
            *filter(None, notes),
            *_unknown_confidence(solution.confidence, options.synchronization),
        ),
        shape_notes=tuple(item.notes for item in samples),
        options=asked,
        group=choice.group,
        search_gain=search_gain,
        run=record,
        trust=trust,
    )


def _unknown_confidence(confidence: FloatArray, method: str) -> tuple[str, ...]:
    """Return the sentence that says that nothing is known about the poses, where that is so."""
    if not np.isnan(confidence).all():
        return ()
    return (f"No confidence is known for any pose: the {method} synchronization does not estimate it.",)


def _constraints(
    shapes: Shapes, options: AlignOptions, fixed: Mapping[str, ArrayLike], fixed_transforms: Mapping[str, FloatArray]
) -> Constraints:
    """Return what stays, by position instead of name, checked."""
    for argument, names in (("fixed", {*fixed, *fixed_transforms}), ("reference", {options.reference} - {""})):
        unknown = sorted(names - set(shapes.names))
        if unknown:
            raise InputError(
                f"{argument}: no aligned shape is called {unknown[0]!r}; names are the files' names without suffix"
            )
    at = shapes.names.index
    return Constraints(
        fixed={at(name): as_rotations(pose, f"fixed[{name}]", dim=3) for name, pose in fixed.items()},
        fixed_transforms={at(name): transform for name, transform in fixed_transforms.items()},
        reference=at(options.reference) if options.reference else 0,
    )


@contextmanager
def _stage(session: AlignSession, times_s: dict[str, float], stage: str) -> Iterator[None]:
    """Say in the store what the run does, and time it."""
    session.enter(stage)
    start_s = time.perf_counter()
    yield
    times_s[stage] = time.perf_counter() - start_s
