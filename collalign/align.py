"""Align a collection: files, samples, pairs, synchronization, maps, as in section 6.3 of Maron et al. (2016)."""

from __future__ import annotations

import platform
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from importlib.metadata import version
from types import MappingProxyType
from typing import Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike

from collalign.engine.command_line import COMMAND, now
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunKeywords, RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.engine.store_file import FINISHED, NUM_FILES
from collalign.join_kinds import join_kinds, kind_notes
from collalign.options import AlignKeywords, AlignOptions, AlignSession
from collalign.output.collection import Collection
from collalign.output.evidence_file import by_label, cycle_errors_deg, part_numbers
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.own import Own, OwnKeywords
from collalign.products.pair import FormerPairs
from collalign.products.run_record import REST, Made, RunRecord
from collalign.products.shapes import Excluded, Shapes
from collalign.stages import steps
from collalign.stages.incomplete.detect import named_incomplete
from collalign.stages.kinds.kind_frames import kind_frames, lone_transform
from collalign.stages.kinds.plan import (
    KindPlan,
    distinct_called,
    kinds_of,
    looks_for_kinds,
    options_of_kind,
    plan_kinds,
    read_all_kinds,
    settled_kinds,
)
from collalign.stages.match_pairs import num_reused_pairs
from collalign.stages.mixed_sides import sides_of_result
from collalign.stages.own_knowledge import (
    given_constraints,
    own_notes,
    own_points,
    with_known_names,
    with_known_options,
    with_marks,
    with_own_samples,
)
from collalign.stages.pieces import Pieces, pieces_that_match
from collalign.stages.poses.placement import common_positions
from collalign.stages.posing import pose_all
from collalign.stages.shape_stage import decided_reading, prepare_shapes
from collalign.stages.steps import Matched, Posed, Run, with_decided_group, with_group
from collalign.stages.trust.assess import confidence_by_evidence
from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.checks import as_options, suggested_option
from data_tools.embedding.copies import find_copies
from data_tools.errors import CollectionError, OptionsError
from data_tools.io.listing import FolderListing
from data_tools.io.objects import ShapesLike, list_shapes
from data_tools.io.source import location
from data_tools.landmark_tables import notes_beside
from data_tools.names import by_known_names
from data_tools.notes import Note
from data_tools.poses import each_moved_by
from data_tools.surface.extra import ExtraSurface
from data_tools.threads import one_blas_thread

_LIBRARIES = ("collalign", "numpy", "scipy", "trimesh", "potpourri3d", "robust-laplacian", "joblib")


class CollectionKeywords(AlignKeywords, RunKeywords, OwnKeywords, total=False):
    """The keywords of :func:`align_collection`."""


@one_blas_thread()
def align_collection(
    shapes: ShapesLike,
    *,
    options: AlignOptions | Mapping[str, Any] | None = None,
    run: RunOptions | Mapping[str, Any] | None = None,
    fixed: Mapping[str, ArrayLike] | None = None,
    kept: Mapping[str, ArrayLike] | None = None,
    recursive: bool = False,
    parts: bool = False,
    include: Sequence[str] = (),
    kinds: Mapping[str, str] | Literal["", "folder"] = "",
    progress: ProgressFactory | bool = True,
    **keywords: Unpack[CollectionKeywords],
) -> Collection:
    """Align shapes consistently: one rigid pose for each, and maps between all of them.

    Parameters
    ----------
    shapes : str, Path, iterable or mapping of name to shape
        A folder of meshes (PLY, STL, OBJ, OFF, GLB, GLTF, VTK, VTP) and point clouds (PLY, PCD, PTS, XYZ, ASC, TXT,
        CSV, VTP, NPZ), a pattern (``data/*/*.stl``) or ``@FILE`` of places, one a line; or several of these, files,
        arrays (n, 3), pairs (V, F), trimesh and Open3D objects.
    options : AlignOptions or mapping, optional
        What decides the result.
    run : RunOptions or mapping, optional
        Processes, store, limits: how the work is done.
    fixed : mapping of name to array_like (3, 3), optional
        ``R_common_shape`` of shapes whose orientation a person has decided; they come out exactly so, and count as
        certain. Or whole transforms (4, 4) from the file to the common frame, which stay to the bit.
    kept : mapping of name to array_like (3, 3) or (4, 4), optional
        The same of shapes that stay where they were, with the confidence that the evidence gives them.
    recursive : bool
        Whether folders in a folder count. Their shapes are called ``folder/name``.
    parts : bool
        Whether the files of a folder in a folder, and files called ``A.part.ply``, are parts of one specimen that
        move as one: cranium and mandible, the bones of a pelvis.
    include : sequence of str
        Patterns of names (``"*.csv"``) of tables that are shapes although they lie beside meshes.
    kinds : mapping of name to str, or "folder"
        The kind of each shape, if you know it, or the first folder of its name; without one it is found.
    progress : bool or callable
        A bar per stage in terminals and notebooks; False is silent; a callable makes another display.
    **keywords
        Fields of ``options`` and ``run`` by themselves, which win: ``seed=1, group="O", jobs=2``. And those of
        :class:`collalign.products.own.Own`, what you know in addition: ``candidates={("a", "b"): rotation}``.

    Returns
    -------
    Collection
        ``save(folder)`` writes it.

    Raises
    ------
    InputError
        If there are no shapes, or ``fixed``, ``candidates`` or ``options.reference`` names a shape that is not there.
    OptionsError
        If an option is unknown or impossible.
    CollectionError
        If fewer than two shapes, or no pair, could be used.
    StoreError
        If the store is damaged or in use.

    Examples
    --------
    >>> aligned = collalign.align_collection("bones", jobs=1)
    >>> aligned.names, aligned["B"].transform.shape
    (('A', 'B', 'C'), (4, 4))
    >>> points = np.load("points.npy")  # (40, 3)
    >>> aligned = collalign.align_collection({"original": points, "turned": points[:, [1, 2, 0]]}, progress=False)
    >>> aligned.rotations[1].round().astype(int).tolist()
    [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    """
    given: dict[str, Any] = {**keywords}
    fields_of = {one.name: kind for kind in (AlignOptions, RunOptions, Own) for one in fields(kind)}
    for name in sorted(given.keys() - fields_of.keys()):
        raise OptionsError(
            f"there is no option {name!r}{suggested_option(name, AlignOptions, RunOptions, Own)}"
        )
    of_kind = {
        kind: {name: given[name] for name in given if fields_of[name] is kind}
        for kind in fields_of.values()
    }
    wanted = as_options("options", options, AlignOptions, of_kind[AlignOptions])
    how = as_options("run", run, RunOptions, of_kind[RunOptions])
    listing = list_shapes(shapes, recursive=recursive, parts=parts, include=include)
    with Session.open(wanted, how, progress_display(progress)) as session:
        return align_listing(
            session,
            listing,
            fixed=fixed or {},
            kept=kept or {},
            own=Own(**of_kind[Own]),
            kinds=kinds,
        )


@one_blas_thread()
def align_listing(
    session: AlignSession,
    listing: FolderListing,
    *,
    fixed: Mapping[str, ArrayLike] = MappingProxyType({}),
    kept: Mapping[str, ArrayLike] = MappingProxyType({}),
    former: FormerPairs | None = None,
    incomplete: Iterable[str] = (),
    own: Own = Own(),  # noqa: B008
    kinds: Mapping[str, str] | Literal["", "folder"] = "",
) -> Collection:
    """Align listed files; :func:`align_collection` and :func:`collalign.extend.add_to_collection` both end here.

    Shapes of several kinds are aligned kind by kind.

    Parameters
    ----------
    session : Session
    listing : FolderListing
    fixed, kept : mapping of name to array_like (3, 3) or (4, 4), optional
        Rotations, or whole transforms, that stay: decided by a person, and of an earlier result.
    former : FormerPairs, optional
        Pairs of an earlier run.
    incomplete : iterable of str
        Shapes that an earlier run found to be incomplete.
    own : Own, optional
        What the caller knows in addition.
    kinds : mapping of str to str, or "folder"
        The kind of each shape by name; of shapes that it lacks the kind is found.
    """
    began_s, times_s = time.perf_counter(), dict[str, float]()
    fixed, kept = (
        by_known_names(argument, poses, listing.names)
        for argument, poses in (("fixed", fixed), ("kept", kept))
    )
    own, session = (
        with_known_names(own, listing.names),
        with_known_options(session, listing.names),
    )
    asked, labels = session.options, kinds_of(kinds, listing.names)
    task = _Task(
        session=session,
        listing=listing,
        fixed=fixed,
        kept=kept,
        former=former,
        incomplete=frozenset(incomplete),
        own=own,
    )
    plan, excluded = None, tuple[Excluded, ...]()
    if labels or looks_for_kinds(asked, len(listing.names)):
        with steps.timed(session, times_s, "kinds"):
            files = dict(zip(listing.names, listing.files, strict=True))
            given = own_points(own, files, asked.cleaning)
            read_by, shapes = read_all_kinds(with_own_samples(session, given), listing, given)
            options = replace(asked, cleaning=read_by.options.cleaning)
            task = replace(task, session=replace(session, options=options))
            plan, excluded = plan_kinds(session, shapes, former, labels), shapes.excluded
            at = {name: i for i, name in enumerate(listing.names)}
            task = replace(task, listing=listing.some(at[name] for name in shapes.names))
    found = _align_one(task) if plan is None else _align_kinds(task, plan, are_given=bool(labels))
    session.enter(FINISHED)
    session.store.set_note(NUM_FILES, str(len(listing.files)))
    times_s = {**found.run.times_s, **times_s}
    times_s[REST] = times_s.get(REST, 0.0)
    times_s[REST] += time.perf_counter() - began_s - sum(times_s.values())
    return replace(
        found,
        excluded=(*excluded, *found.excluded),
        notes=(*found.notes, *notes_beside(listing)),
        run=replace(
            found.run,
            times_s=times_s,
            skipped=listing.skipped_names,
            left_out=listing.left_out,
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """Shapes of one kind, what is known of them, and the session that aligns them together."""

    session: AlignSession
    listing: FolderListing
    fixed: Mapping[str, ArrayLike]
    kept: Mapping[str, ArrayLike]
    former: FormerPairs | None
    incomplete: frozenset[str]
    own: Own

    def some(self, chosen: Sequence[int], *, has_reference: bool) -> _Task:
        """Return the task of some of the shapes, by position; directions are those of the kind of the reference."""
        listing = self.listing.some(chosen)
        names = {*listing.names}
        session = self.session
        former = None if self.former is None else self.former.some(chosen)
        return _Task(
            session=replace(
                session,
                options=options_of_kind(session.options, names, has_reference=has_reference),
            ),
            listing=listing,
            fixed={name: pose for name, pose in self.fixed.items() if name in names},
            kept={name: pose for name, pose in self.kept.items() if name in names},
            former=former if former is not None and former.num_shapes else None,
            incomplete=self.incomplete & names,
            own=self.own.some(names),
        )


def _align_kinds(task: _Task, plan: KindPlan, *, are_given: bool) -> Collection:
    """Align each kind of shapes by itself, and each that shares a frame with another to this one."""
    names, whole = plan.shapes.names, task.listing.names
    at = {name: i for i, name in enumerate(whole)}
    reference = task.session.options.reference or next(iter(task.own.marks), names[0])
    root = plan.kind_of(reference)
    tasks = {
        kind: task.some([at[names[i]] for i in members.tolist()], has_reference=kind == root)
        for kind, members in enumerate(plan.members)
    }
    found = list[Collection]()
    called, confidence, members = list[str](), list[float](), list[IntArray]()
    for kind, own in tasks.items():
        parts = [own]
        if len(own.listing.names) > 1:
            try:
                found.append(_align_one(own))
            except CollectionError:
                if task.session.options.strict:
                    raise
                parts = [own.some([i], has_reference=False) for i in range(len(own.listing.names))]
            else:
                parts = []
        found += [_alone(one, plan.shapes) for one in parts]
        num = max(len(parts), 1)
        called += [plan.names[kind]] * num
        confidence += [plan.confidence[kind]] * num
    position = {name: i for i, name in enumerate(names)}
    members = [np.array([position[name] for name in one.names]) for one in found]
    rotations = np.tile(np.eye(3), (len(names), 1, 1))
    for one, own_members in zip(found, members, strict=True):
        rotations[own_members] = one.rotations
    of_reference = next(k for k, one in enumerate(found) if reference in one.names)
    with steps.timed(task.session, {}, "kinds"):
        frames = kind_frames(
            with_decided_group(task.session, "SO"),
            plan.shapes,
            members,
            rotations,
            plan.log_odds,
            root=of_reference,
            settled=settled_kinds(
                task.former, [one.names for one in found], {*task.kept, *task.fixed}
            ),
        )
    result = join_kinds(names, found, frames, distinct_called(called), confidence)
    asked = task.session.options
    named = [direction for direction in ("up", "front") if getattr(asked, direction)]
    said = kind_notes(result.kinds, result.names, are_given=are_given, named=named)
    return replace(
        result,
        notes=(*said, *result.notes),
        options=replace(asked, cleaning=found[of_reference].options.cleaning),
    )


def _align_one(task: _Task) -> Collection:
    """Align shapes of one kind."""
    session, listing, own, times_s = task.session, task.listing, task.own, dict[str, float]()
    with steps.timed(session, times_s, "shapes"):
        files = dict(zip(listing.names, listing.files, strict=True))
        given = own_points(own, files, session.options.cleaning)
        session = with_marks(with_own_samples(session, given), own)

        shapes = prepare_shapes(session, listing, given)
        decided = decided_reading(session, shapes)
        if decided is not session:
            session, shapes = decided, prepare_shapes(decided, listing, given)

        def read(
            pieces: Pieces, extra: Mapping[str, ExtraSurface] = MappingProxyType({})
        ) -> Shapes:
            return prepare_shapes(session, listing, given, extra, pieces)

        pieces = pieces_that_match(session, shapes, listing.names, read)
        shapes = read(pieces) if pieces else shapes
        constraints = given_constraints(shapes, session.options, own, task.fixed, task.kept)
    run = Run(
        session=session,
        shapes=shapes,
        read_without=partial(read, pieces),
        constraints=constraints,
        former=task.former,
        times_s=times_s,
    )
    missing = named_incomplete(session.options, shapes.names, {*task.incomplete} & {*shapes.names})
    run, matched, posed = pose_all(run, missing)
    session.enter(FINISHED)
    of_pieces = (Note("components-joined", tuple(pieces)),) if pieces else ()
    matched = replace(
        matched,
        notes=(
            *own_notes(own, given, run.constraints, posed.rotations),
            *of_pieces,
            *matched.notes,
        ),
    )
    found = _collected(run, matched, posed, listing)
    return replace(found, own=own.kinds)


def _alone(task: _Task, shapes: Shapes) -> Collection:
    """Return the result of one shape that has no other of its kind: as in its file, in the middle and at one size."""
    (name,), options = task.listing.names, task.session.options
    at = shapes.names.index(name)
    sample = shapes.samples[at]
    labels = np.arange(len(sample.positions))[None]
    pose = task.kept.get(name, task.fixed.get(name, np.eye(3)))
    transforms = lone_transform(sample, np.asarray(pose, dtype=np.float64), options.scaling)[None]
    positions = common_positions([sample], transforms)
    in_file = each_moved_by(np.asarray(np.linalg.inv(transforms), dtype=np.float64), positions)
    return Collection(
        names=(name,),
        files=(location(shapes.files[at]),),
        digests=(shapes.digests[at],),
        transforms=read_only(transforms),
        confidence=read_only(np.full(1, np.nan)),
        samples=read_only(sample.vertex_indices[None]),
        positions=read_only(positions),
        maps=ConsistentMaps(names=(name,), labels=read_only(labels)),
        consensus=read_only(positions[0]),
        landmarks=read_only(in_file),
        pairs=(),
        alternatives=((),),
        part_numbers=read_only(np.zeros(1, dtype=np.int64)),
        by_hand={name: float("nan")} if name in task.fixed else {},
        options=options,
        group="SO",
        run=_record({}, 0, ()),
        cycle_errors_deg=read_only(np.zeros(0)),
        fresh=Made(
            files=(shapes.files[at],),
            coordinates=read_only(sample.coordinates[None]),
            invariants=read_only(sample.invariants[None]),
            shape_notes=(sample.notes,),
        ),
    )


def matched_samples(
    session: AlignSession,
    listing: FolderListing,
    extra: Mapping[str, ExtraSurface] = MappingProxyType({}),
    assembled: Iterable[str] = (),
) -> Shapes:
    """Return the samples of listed files as an alignment with the session's options matches them.

    It may have left out the ``extra`` material of some, and read all pieces of some that are ``assembled``, by name.
    """
    return prepare_shapes(session, listing, extra=extra, pieces=dict.fromkeys(assembled, "all"))


def _collected(run: Run, matched: Matched, posed: Posed, listing: FolderListing) -> Collection:
    """Return the result of a run: the one place where a collection is made."""
    shapes, solution, wanted = run.shapes, posed.solution, run.session.options
    samples, positions = shapes.samples, common_positions(shapes.samples, posed.transforms)
    in_files = each_moved_by(
        np.asarray(np.linalg.inv(posed.transforms), dtype=np.float64), positions
    )
    session = with_group(run, matched.group).session
    reflected = np.linalg.det(posed.transforms[:, :3, :3]) < 0
    signatures, notes = [item.signature for item in samples], [item.notes for item in samples]
    copies = find_copies(shapes.names, shapes.digests, signatures, notes)
    return Collection(
        names=shapes.names,
        files=tuple(location(file) for file in shapes.files),
        digests=shapes.digests,
        transforms=read_only(posed.transforms),
        confidence=read_only(solution.confidence),
        samples=read_only(np.stack([item.vertex_indices for item in samples])),
        positions=read_only(positions),
        maps=ConsistentMaps(names=shapes.names, labels=read_only(posed.labels)),
        consensus=read_only(posed.consensus),
        landmarks=read_only(by_label(in_files, posed.labels)),
        pairs=posed.pairs,
        alternatives=solution.alternatives,
        part_numbers=read_only(part_numbers(solution.parts, len(samples))),
        excluded=(*shapes.excluded, *matched.failed),
        notes=(
            *solution.warnings,
            *shapes.notes,
            *sides_of_result(
                matched.notes, shapes.names, posed.pairs, reflected, posed.side_limits
            ),
            *posed.notes,
            *_unknown_confidence(solution.confidence, wanted.synchronization),
            *(one.note for one in copies),
        ),
        copies=copies,
        incomplete=posed.incomplete,
        extra=posed.extra,
        assembled=tuple(
            name
            for name, how in zip(shapes.names, shapes.cleaning, strict=True)
            if how.components == "all" and wanted.cleaning.components != "all"
        ),
        limited_by={
            name: code for name, code in zip(shapes.names, posed.limited_by, strict=False) if code
        },
        by_hand=_by_hand(run, posed),
        options=wanted,
        group=matched.group,
        run=_record(
            run.times_s,
            session.num_reused("shapes", shapes.keys)
            + num_reused_pairs(session, shapes, posed.pairs),
            listing.skipped_names,
        ),
        cycle_errors_deg=read_only(cycle_errors_deg(posed.pairs, len(samples))),
        fresh=Made(
            files=shapes.files,
            coordinates=read_only(np.stack([item.coordinates for item in samples])),
            invariants=read_only(np.stack([item.invariants for item in samples])),
            shape_notes=tuple(item.notes for item in samples),
            trust=posed.trust,
            vertices=posed.vertices,
        ),
    )


def _record(times_s: dict[str, float], num_reused: int, skipped: tuple[str, ...]) -> RunRecord:
    """Return how a run went that ends now."""
    return RunRecord(
        times_s=times_s,
        versions={"python": platform.python_version()}
        | {name: version(name) for name in _LIBRARIES},
        num_reused=num_reused,
        skipped=skipped,
        command=COMMAND.get(),
        date=now(),
    )


def _by_hand(run: Run, posed: Posed) -> dict[str, float]:
    """Return the shapes that a person posed, each with the confidence that the evidence alone gives to that pose."""
    known = confidence_by_evidence(posed.trust, len(run.shapes.names))
    return {run.shapes.names[i]: float(known[i]) for i in sorted(run.constraints.by_hand)}


def _unknown_confidence(confidence: FloatArray, method: str) -> tuple[Note, ...]:
    """Return the note that says that nothing is known about the poses, where that is so."""
    if not np.isnan(confidence).all():
        return ()
    return (Note("no-confidence", values={"method": method}),)
