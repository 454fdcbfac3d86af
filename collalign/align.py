"""Align a collection: files, samples, pairs, synchronization, maps, as in section 6.3 of Maron et al. (2016)."""

from __future__ import annotations

import platform
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from importlib.metadata import version
from types import MappingProxyType
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from collalign.engine.command_line import COMMAND, now
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunKeywords, RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.engine.store_file import FINISHED
from collalign.options import AlignKeywords, AlignOptions, AlignSession
from collalign.output.collection import Collection
from collalign.output.evidence_file import by_label, cycle_errors_deg, part_numbers
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.own import Own, OwnKeywords
from collalign.products.pair import FormerPairs
from collalign.products.run_record import REST, Made, RunRecord
from collalign.products.shapes import Shapes
from collalign.stages import steps
from collalign.stages.components import pose_with_components
from collalign.stages.extra_material import pose_without_extra
from collalign.stages.incomplete.detect import named_incomplete, open_among_closed
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
from collalign.stages.poses.placement import common_positions
from collalign.stages.posing import looks_for_incomplete
from collalign.stages.shape_stage import decided_reading, prepare_shapes
from collalign.stages.steps import Matched, Posed, Run, with_group
from collalign.stages.trust.assess import confidence_by_evidence
from data_tools.arrays import FloatArray, read_only
from data_tools.checks import as_options, suggested_option
from data_tools.embedding.copies import find_copies
from data_tools.errors import OptionsError
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
        Whether folders in a folder count. Files of one name are called ``folder/name``.
    parts : bool
        Whether the files of a folder in a folder, and files called ``A.part.ply``, are parts of one specimen that
        move as one: cranium and mandible, the bones of a pelvis.
    include : sequence of str
        Patterns of names (``"*.csv"``) of the tables that are shapes although they lie beside meshes. Others there
        are landmarks, measurements or labels, and left out by name.
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
    >>> points = np.random.default_rng(0).random((40, 3))
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> aligned = collalign.align_collection({"original": points, "rotated": points @ quarter}, progress=False)
    >>> bool(np.allclose(aligned.rotations[1], quarter, atol=1e-3))
    True
    """
    given: dict[str, Any] = {**keywords}
    kinds = {one.name: kind for kind in (AlignOptions, RunOptions, Own) for one in fields(kind)}
    for name in sorted(given.keys() - kinds.keys()):
        raise OptionsError(
            f"there is no option {name!r}{suggested_option(name, AlignOptions, RunOptions, Own)}"
        )
    of_kind = {
        kind: {name: given[name] for name in given if kinds[name] is kind}
        for kind in kinds.values()
    }
    wanted = as_options("options", options, AlignOptions, of_kind[AlignOptions])
    how = as_options("run", run, RunOptions, of_kind[RunOptions])
    listing = list_shapes(shapes, recursive=recursive, parts=parts, include=include)
    with Session.open(wanted, how, progress_display(progress)) as session:
        return align_listing(
            session, listing, fixed=fixed or {}, kept=kept or {}, own=Own(**of_kind[Own])
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
) -> Collection:
    """Align listed files; :func:`align_collection` and :func:`collalign.extend.add_to_collection` both end here.

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
    with steps.timed(session, times_s, "shapes"):
        files = dict(zip(listing.names, listing.files, strict=True))
        given = own_points(own, files, session.options.cleaning)
        session = with_marks(with_own_samples(session, given), own)

    def posed_with(session: AlignSession) -> tuple[Run, Matched, Posed]:
        with steps.timed(session, times_s, "shapes"):
            shapes = prepare_shapes(session, listing, given)
            decided = decided_reading(session, shapes)
            if decided is not session:
                session, shapes = decided, prepare_shapes(decided, listing, given)
            constraints = given_constraints(shapes, session.options, own, fixed, kept)
        run = Run(
            session=session,
            shapes=shapes,
            constraints=constraints,
            former=former,
            times_s=times_s,
        )
        missing = named_incomplete(session.options, shapes.names, {*incomplete} & {*shapes.names})
        if not missing and looks_for_incomplete(session.options):
            stay = {
                *constraints.fixed,
                *((constraints.reference,) if session.options.reference else ()),
            }
            found_open = open_among_closed(session.options, shapes)
            missing = {i: why for i, why in found_open.items() if i not in stay}
        return pose_without_extra(
            run, missing, lambda extra: prepare_shapes(session, listing, given, extra)
        )

    run, matched, posed = pose_with_components(session, posed_with)
    session.enter(FINISHED)
    matched = replace(
        matched, notes=(*own_notes(own, given, run.constraints, posed.rotations), *matched.notes)
    )
    times_s[REST] = time.perf_counter() - began_s - sum(times_s.values())
    found = _collected(run, matched, posed, listing)
    return replace(found, own=own.kinds)


def matched_samples(
    session: AlignSession,
    listing: FolderListing,
    extra: Mapping[str, ExtraSurface] = MappingProxyType({}),
) -> Shapes:
    """Return the samples of listed files as an alignment with the session's options matches them.

    It may have left out the ``extra`` material of some, by name.
    """
    return prepare_shapes(session, listing, extra=extra)


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
            *notes_beside(listing),
        ),
        copies=copies,
        incomplete=posed.incomplete,
        extra=posed.extra,
        by_hand=_by_hand(run, posed),
        options=wanted,
        group=matched.group,
        run=RunRecord(
            times_s=run.times_s,
            versions={"python": platform.python_version()}
            | {name: version(name) for name in _LIBRARIES},
            num_reused=session.num_reused("shapes", shapes.keys)
            + num_reused_pairs(session, shapes, posed.pairs),
            skipped=listing.skipped_names,
            left_out=listing.left_out,
            command=COMMAND.get(),
            date=now(),
        ),
        cycle_errors_deg=read_only(cycle_errors_deg(posed.pairs, len(samples))),
        fresh=Made(
            files=shapes.files,
            digests=shapes.digests,
            coordinates=read_only(np.stack([item.coordinates for item in samples])),
            invariants=read_only(np.stack([item.invariants for item in samples])),
            shape_notes=tuple(item.notes for item in samples),
            trust=posed.trust,
            vertices=posed.vertices,
        ),
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
