"""Bounds the energy of all arrangements of a finished result, or of some of its shapes, from below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.align import matched_samples
from collalign.analysis.procrustes import pose_changes
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.products.pair import AlignedPair
from collalign.tools.certify.result import CertifiedCollection, PairEnergies
from collalign.tools.certify.rounds import Rounds, bound_arrangements, problem_of
from data_tools.arrays import read_only
from data_tools.checks import as_options, check_number
from data_tools.errors import InputError, OptionsError
from data_tools.io.listing import FolderListing
from data_tools.names import known_names
from data_tools.threads import one_blas_thread


@one_blas_thread()
def certify_collection(
    result: Collection | str | Path,
    *,
    shapes: Sequence[str] = (),
    budget_s: float = 3600.0,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
) -> CertifiedCollection:
    """Prove how much cheaper any other consistent arrangement of a result's shapes could be at most.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote; the files that it read must still be there.
    shapes : sequence of str
        Names of the shapes to certify; all by default. The pairs among them that the run matched count.
    budget_s : float
        Seconds after which no further proof of a pair begins; pairs without one count with a bound that costs
        nothing.
    run : RunOptions or mapping, optional
        With the store of the run the shapes need not be prepared again, and an interrupted certification goes on.
    progress : bool or callable
        As for :func:`collalign.align_collection`.

    Raises
    ------
    InputError
        If a shape is unknown, its file has vanished, or no two of the shapes were matched.
    OptionsError
        If the budget is not positive, or the shapes' embedding has more than the coordinates of space.

    Examples
    --------
    >>> found = collalign.certify_collection("aligned")
    >>> 0.9 < found.joint.share <= 1.0
    True
    """
    check_number("budget_s", budget_s, positive=True)
    collection = load(result)
    members = _members(collection, shapes)
    pairs = _pairs_among(collection, members)
    listing = FolderListing(files=collection.source_files(), names=collection.names).some(members)
    shown, frames = progress_display(progress), collection.rotations[members]
    decided = replace(collection.options, group="O" if collection.group == "O" else "SO")
    with Session.open(decided, as_options("run", run, RunOptions), shown) as session:
        ignored = collection.extra if decided.ignore_extra else ()
        extra = {collection.names[one.shape]: one.surface for one in ignored}
        prepared = matched_samples(session, listing, extra, collection.assembled)
        if prepared.names != listing.names:
            raise InputError(f"{prepared.excluded[0].file} cannot be read as it was for the result")
        if prepared.samples[0].coordinates.shape[1] != 3:
            raise OptionsError(
                "the shapes are embedded in more than space: there is no joint bound for such embeddings"
            )
        samples = [(sample.coordinates, sample.invariants) for sample in prepared.samples]
        edges = np.array([(pair.target, pair.source) for pair in pairs], dtype=np.int64)
        problems = [problem_of(samples[i], samples[j], session.options.group) for i, j in edges]
        rounds = Rounds(
            session=session,
            samples=samples,
            keys=prepared.keys,
            energies=PairEnergies(len(samples), edges, problems),
            candidates=[pair.rotations for pair in pairs],
        )
        joint = bound_arrangements(rounds, frames, budget_s)
    changes, same = pose_changes(frames, joint.frames, collection.part_numbers[members])
    return CertifiedCollection(
        names=listing.names,
        members=read_only(np.array(members)),
        coordinates=read_only(np.array([sample[0] for sample in samples])),
        invariants=read_only(np.array([sample[1] for sample in samples])),
        joint=joint,
        changes_deg=read_only(changes),
        same_chirality=read_only(same),
        confidence=read_only(collection.confidence[members]),
    )


def _members(collection: Collection, shapes: Sequence[str]) -> list[int]:
    """Return the positions of the named shapes in the order of the result, of all where none is named."""
    named = {*known_names("shapes", shapes, collection.names).values()}
    return [i for i, name in enumerate(collection.names) if not named or name in named]


def _pairs_among(collection: Collection, members: Sequence[int]) -> Sequence[AlignedPair]:
    """Return the pairs of the result with both shapes among the members, by position among these."""
    pairs = collection.some(np.array(members)).pairs
    if not pairs:
        raise InputError(
            "shapes: the result holds no pair of these shapes; name others, or align with --pairs all"
        )
    return pairs
