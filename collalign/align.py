"""Align a collection: files, samples, pairs, synchronization, maps, as in section 6.3 of Maron et al. (2016)."""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from collalign.collection import AlignedCollection, Alternative, ConsistentMaps, RunRecord
from collalign.engine.stage import ProgressFactory
from collalign.engine.store.store import Store
from collalign.options import AlignOptions, RunOptions
from collalign.stages.pairs.choose import FormerPairs, MatchedPairs, choose_and_match
from collalign.stages.pairs.match import synchronize_pairs
from collalign.stages.poses.consistency import Consistency, make_consistent
from collalign.stages.proofs import certify_pairs
from collalign.stages.shapes import PreparedShapes, prepare_shapes, stored_samples
from data_tools.arrays import FloatArray, as_rotations, read_only
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError
from data_tools.io.files import readable_name
from data_tools.io.shapes import FolderListing, read_folder
from data_tools.threads import one_blas_thread

_LIBRARIES = ("collalign", "numpy", "scipy", "trimesh", "potpourri3d", "robust-laplacian", "joblib")


@one_blas_thread()
def align_collection(
    folder: str | Path,
    *,
    options: AlignOptions | None = None,
    run: RunOptions | None = None,
    fixed: Mapping[str, ArrayLike] | None = None,
    progress: ProgressFactory | None = None,
) -> AlignedCollection:
    """Align all shapes of a folder consistently.

    Parameters
    ----------
    folder : str or Path
        Meshes (PLY, OFF, OBJ, STL, GLB) and point clouds (PLY, PCD, XYZ, TXT, CSV, NPZ) in arbitrary poses; other
        files are skipped and named in the result.
    options : AlignOptions, optional
        What decides the result.
    run : RunOptions, optional
        Processes, store, limits: how the work is done.
    fixed : mapping of name to array_like (3, 3), optional
        ``R_common_shape`` of shapes whose orientation a person has decided; they come out exactly so.
    progress : callable, optional
        Makes a progress display per stage; :class:`collalign.engine.jobs.progress.ProgressBar` is one. Silent by
        default.

    Returns
    -------
    AlignedCollection
        ``save(folder)`` writes it.

    Raises
    ------
    InputError
        If the folder holds no shapes, or ``fixed`` or ``options.reference`` names a shape that is not there.
    CollectionError
        If fewer than two shapes, or no pair, could be used.
    StoreError
        If the store is damaged or in use.

    Examples
    --------
    >>> collection = align_collection("teeth")  # doctest: +SKIP
    >>> collection.maps["tooth1", "tooth2"]     # doctest: +SKIP
    """
    options = options or AlignOptions()
    run = run or RunOptions()
    return align_listing(read_folder(folder), options, run, fixed=fixed or {}, progress=progress)


@one_blas_thread()
def align_listing(
    listing: FolderListing,
    options: AlignOptions,
    run: RunOptions,
    *,
    fixed: Mapping[str, ArrayLike],
    placed: Mapping[str, FloatArray] | None = None,
    former: FormerPairs | None = None,
    progress: ProgressFactory | None = None,
) -> AlignedCollection:
    """Align listed files; :func:`align_collection` and :func:`collalign.extend.add_to_collection` both end here.

    Parameters
    ----------
    listing : FolderListing
    options : AlignOptions
    run : RunOptions
    fixed : mapping of name to array_like (3, 3)
        Rotations that stay.
    placed : mapping of name to ndarray (4, 4), optional
        Whole transforms that stay.
    former : FormerPairs, optional
        Pairs of an earlier run.
    progress : callable, optional
    """
    with Store.open(run.store) if run.store else Store.memory() as store:
        return _align(listing, options, run, store, fixed, placed, former, progress)


def _align(
    listing: FolderListing,
    options: AlignOptions,
    run: RunOptions,
    store: Store,
    fixed: Mapping[str, ArrayLike],
    placed: Mapping[str, FloatArray] | None,
    former: FormerPairs | None,
    progress: ProgressFactory | None,
) -> AlignedCollection:
    times_s: dict[str, float] = {}
    with _timed(times_s, "shapes"):
        shapes = prepare_shapes(listing, options, run, store, progress=progress)
        _check_names(shapes, options, fixed)
        samples = stored_samples(store, shapes)
    with _timed(times_s, "pairs"):
        matched = choose_and_match(
            shapes,
            samples,
            options,
            run,
            store,
            former=former,
            any_mirrored=_any_mirrored(fixed),
            progress=progress,
        )
    pairs, choice = matched.pairs, matched.choice
    decided = replace(options, group=choice.group)
    notes: tuple[str, ...] = (choice.note,) if choice.note else ()
    if options.certify:
        with _timed(times_s, "proofs"):
            solution = synchronize_pairs(pairs, len(samples), decided)
            pairs, report = certify_pairs(shapes, pairs, solution, decided, run, store, progress=progress)
            notes += (str(report),)
    with _timed(times_s, "synchronization"):
        consistent = make_consistent(samples, pairs, decided, fixed=fixed, placed=placed)
    record = RunRecord(
        times_s=times_s,
        versions={"python": platform.python_version()} | {name: version(name) for name in _LIBRARIES},
        num_reused=shapes.num_reused + matched.num_reused,
    )
    return _collect(listing, shapes, samples, matched, consistent, notes, options, record)


def _collect(
    listing: FolderListing,
    shapes: PreparedShapes,
    samples: list[Samples],
    matched: MatchedPairs,
    consistent: Consistency,
    notes: tuple[str, ...],
    options: AlignOptions,
    record: RunRecord,
) -> AlignedCollection:
    """Put the stages' results together; arrays become read-only."""
    solution = consistent.synchronization
    return AlignedCollection(
        names=shapes.names,
        files=shapes.files,
        transforms=read_only(consistent.transforms),
        rotations=read_only(consistent.rotations),
        reflected=read_only(np.linalg.det(consistent.rotations) < 0),
        confidence=solution.confidence,
        samples=tuple(item.vertex_indices for item in samples),
        positions=read_only(consistent.positions),
        maps=ConsistentMaps(names=shapes.names, labels=read_only(consistent.labels)),
        consensus=read_only(consistent.consensus),
        pairs=consistent.pairs,
        alternatives=tuple(
            tuple(Alternative(rotation=pose.rotation[:3, :3], log_odds=pose.log_odds) for pose in poses)
            for poses in solution.alternatives
        ),
        groups=solution.groups,
        excluded=(*shapes.excluded, *matched.failed),
        skipped=tuple(readable_name(path) for path in listing.skipped),
        notes=(*solution.warnings, *notes, *_unknown_confidence(solution.confidence)),
        shape_notes=tuple(item.notes for item in samples),
        options=options,
        group=matched.choice.group,
        run=record,
    )


def _unknown_confidence(confidence: FloatArray) -> tuple[str, ...]:
    """Return the sentence that says that nothing is known about the poses, where that is so."""
    if not np.isnan(confidence).all():
        return ()
    return ("No confidence is known for any pose: the spectral synchronization does not estimate it.",)


def _any_mirrored(fixed: Mapping[str, ArrayLike]) -> bool:
    """Whether a pose set by hand mirrors its shape."""
    poses = [as_rotations(pose, f"fixed[{name}]", dim=3) for name, pose in fixed.items()]
    return any(bool(np.linalg.det(pose) < 0) for pose in poses)


def _check_names(shapes: PreparedShapes, options: AlignOptions, fixed: Mapping[str, ArrayLike]) -> None:
    wanted = {"fixed": set(fixed), "reference": {options.reference} - {""}}
    for argument, names in wanted.items():
        unknown = sorted(names - set(shapes.names))
        if unknown:
            raise InputError(
                f"{argument}: no aligned shape is called {unknown[0]!r}; names are the files' names without suffix"
            )


@contextmanager
def _timed(times_s: dict[str, float], stage: str) -> Iterator[None]:
    start_s = time.perf_counter()
    yield
    times_s[stage] = time.perf_counter() - start_s
