"""Align a collection: files, samples, pairs, synchronization, maps, as in section 6.3 of Maron et al. (2016)."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from types import MappingProxyType
from typing import Any, Literal, Unpack

from numpy.typing import ArrayLike

from collalign.driver.one_kind import KindTask, align_one
from collalign.driver.several_kinds import align_kinds
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunKeywords, RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.engine.store_file import FINISHED, NUM_FILES
from collalign.options import AlignKeywords, AlignOptions, AlignSession
from collalign.output.collection import Collection
from collalign.products.own import Own, OwnKeywords
from collalign.products.pair import FormerPairs
from collalign.products.run_record import REST
from collalign.products.shapes import Excluded, Shapes
from collalign.stages import steps
from collalign.stages.kinds.plan import (
    kinds_of,
    looks_for_kinds,
    plan_kinds,
    read_all_kinds,
)
from collalign.stages.own_knowledge import (
    own_points,
    with_known_names,
    with_known_options,
    with_own_samples,
)
from collalign.stages.shape_stage import prepare_shapes
from data_tools.checks import as_options, suggested_option
from data_tools.errors import OptionsError
from data_tools.io.listing import FolderListing
from data_tools.io.objects import ShapesLike, list_shapes
from data_tools.landmark_tables import notes_beside
from data_tools.names import by_known_names
from data_tools.surface.extra import ExtraSurface
from data_tools.threads import one_blas_thread


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
    listed_as: Sequence[str] = (),
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
    listed_as : sequence of str, optional
        Names by which ``kinds`` knows the shapes, where they are not those of the listing.
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
    listed_as = listed_as or listing.names
    said, asked = kinds_of(kinds, [*dict.fromkeys(listed_as)]), session.options
    labels = {
        name: said[one] for name, one in zip(listing.names, listed_as, strict=True) if one in said
    }
    task = KindTask(
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
            # Which piece is the object is decided kind by kind: others may be of one piece.
            walls = read_by.options.cleaning.inner
            options = replace(asked, cleaning=replace(asked.cleaning, inner=walls))
            task = replace(task, session=replace(session, options=options))
            plan, excluded = plan_kinds(session, shapes, former, labels), shapes.excluded
            at = {name: i for i, name in enumerate(listing.names)}
            task = replace(task, listing=listing.some(at[name] for name in shapes.names))
    found = align_one(task) if plan is None else align_kinds(task, plan, are_given=bool(labels))
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
