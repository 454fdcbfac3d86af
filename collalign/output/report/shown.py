"""Which shapes of a large collection the page shows: a browser holds some hundreds, collections have thousands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from collalign.products.evidence import CollectionView
from collalign.products.incomplete import Incomplete
from data_tools.arrays import IntArray

#: Most shapes of a page. With so many it opens in seconds; matrix, map and tree grow with their square.
MOST_SHOWN = 600


def shown_part(view: CollectionView, most: int = MOST_SHOWN) -> CollectionView:
    """Return the collection as far as a page shows it: all of it, or a choice of its shapes with a note that says so.

    Parameters
    ----------
    view : CollectionView
    most : int
        Shapes to show.
    """
    if view.num_shapes <= most:
        return view
    chosen = chosen_shapes(view, most)
    position = {int(shape): at for at, shape in enumerate(chosen)}
    note = (
        f"{most} of {view.num_shapes} shapes are shown below, the {most // 2} most doubtful ones and others evenly "
        "spaced; alignment.json, pairs.csv and the exports hold all of them."
    )
    return replace(
        view,
        names=tuple(view.names[i] for i in chosen),
        files=tuple(view.files[i] for i in chosen),
        transforms=view.transforms[chosen],
        confidence=view.confidence[chosen],
        samples=view.samples[chosen],
        vertices=tuple(view.vertices[i] for i in chosen),
        faces=tuple(view.faces[i] for i in chosen),
        alternatives=tuple(view.alternatives[i] for i in chosen),
        part_numbers=view.part_numbers[chosen],
        labels={column: tuple(values[i] for i in chosen) for column, values in view.labels.items()},
        pairs=tuple(
            replace(pair, target=position[pair.target], source=position[pair.source])
            for pair in view.pairs
            if pair.target in position and pair.source in position
        ),
        notes=(*view.notes, note),
        incomplete=_chosen_incomplete(view, position),
    )


def _chosen_incomplete(view: CollectionView, position: dict[int, int]) -> tuple[Incomplete, ...]:
    """Return the incomplete shapes that are shown, with those of their partners that are."""
    chosen = []
    for one in view.incomplete:
        kept = np.array([partner in position for partner in one.partners.tolist()], dtype=bool)
        if one.shape in position:
            partners = np.array([position[i] for i in one.partners[kept].tolist()], dtype=np.int64)
            chosen.append(replace(one, shape=position[one.shape], partners=partners, overlaps=one.overlaps[kept]))
    return tuple(chosen)


def chosen_shapes(view: CollectionView, most: int) -> IntArray:
    """Return positions of the least confident shapes, half of ``most``, and of others evenly spaced; ascending."""
    order = np.argsort(np.nan_to_num(view.confidence), kind="stable")
    doubtful, others = order[: most // 2], np.sort(order[most // 2 :])
    spaced = others[np.linspace(0, len(others) - 1, most - len(doubtful)).round().astype(np.int64)]
    return np.sort(np.concatenate([doubtful, spaced]))
