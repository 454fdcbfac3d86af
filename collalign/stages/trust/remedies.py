"""What to try where poses are in doubt: a note for each cause that the shapes themselves show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from collalign.options import AUTO, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.products.trust import DOUBT
from collalign.stages.poses.synchronize import pair_graph
from collalign.synchronization.clusters import pair_affinity, spectral_clusters
from data_tools.arrays import BoolArray, FloatArray
from data_tools.notes import MAX_NAMED, Note, listed
from data_tools.surface.cleaning import share_kept

#: Folders of which at least this share is in doubt may hold several kinds of shapes, ...
MOST_IN_DOUBT = 0.5
#: ... where pairs across the parts that agree among themselves match so many times worse than those within. Folders
#: of two or three kinds of SHREC07, teeth and skulls had 1.9 to 3.5; of those of one kind only glasses had two parts.
WORSE_ACROSS = 1.5
#: Shapes below this confidence may be incomplete; above it a rival pose is the likelier reason.
MAY_BE_CUT = 0.7


def remedies(
    session: AlignSession,
    shapes: Shapes,
    pairs: Sequence[Pair],
    confidence: FloatArray,
    strange: BoolArray,
) -> list[Note]:
    """Return notes that name the option which helps where most shapes, or open surfaces, are in doubt.

    Parameters
    ----------
    session : Session
        With a decided group.
    shapes : Shapes
    pairs : sequence of Pair
        As first matched.
    confidence : ndarray, shape (N,)
    strange : ndarray of bool, shape (N,)
        Shapes that resemble no other one: they are of another kind, not incomplete.
    """
    options, said = session.options, []
    in_doubt = np.flatnonzero(~(confidence >= DOUBT))
    mostly = len(in_doubt) >= MOST_IN_DOUBT * len(confidence)
    kinds = (
        _kinds(pairs, len(confidence), options.group) if mostly and options.clusters == 1 else []
    )
    if kinds:
        groups = "; ".join(listed([shapes.names[i] for i in kind]) for kind in kinds)
        said.append(Note("several-kinds", values={"num": len(kinds), "groups": groups}))
    elif options.incomplete == AUTO:
        may_be_cut = [i for i in _doubted(confidence) if not strange[i]][:MAX_NAMED]
        cut = [shapes.names[i] for i in may_be_cut if shapes.samples[i].rim != "closed"]
        if cut:
            said.append(Note("open-borders", tuple(cut)))
    said += components_left_out(shapes, in_doubt.tolist())
    return said


def components_left_out(shapes: Shapes, in_doubt: Iterable[int]) -> list[Note]:
    """Return the note that names those of some shapes which lost components when they were read, if there are any."""
    lost = [i for i in in_doubt if round(share_kept(shapes.samples[i].notes), 2) < 1]
    return [Note("components-left-out", tuple(shapes.names[i] for i in lost))] if lost else []


def _doubted(confidence: FloatArray) -> list[int]:
    return [i for i in np.argsort(confidence, kind="stable").tolist() if confidence[i] < MAY_BE_CUT]


def _kinds(pairs: Sequence[Pair], num: int, group: str) -> list[list[int]]:
    """Return the parts of shapes whose pairs agree, where those between them match much worse; none otherwise."""
    labels = spectral_clusters(pair_affinity(pair_graph(pairs, num, group)), None)
    energies = np.array([pair.energies.min() for pair in pairs])
    across = np.array([labels[pair.target] != labels[pair.source] for pair in pairs])
    if (
        not across.any()
        or across.all()
        or np.median(energies[across]) < WORSE_ACROSS * np.median(energies[~across])
    ):
        return []
    return [np.flatnonzero(labels == part).tolist() for part in range(labels.max() + 1)]
