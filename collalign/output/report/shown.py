"""Which shapes of a large collection a page shows: a browser holds some hundreds, collections have thousands.

The first page shows the most doubtful shapes and others evenly spaced. All shapes are on further pages, each with
shapes that were compared with each other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from collalign.output.collection_data import CollectionData
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.shapes import Incomplete
from data_tools.arrays import IntArray
from data_tools.notes import Note

T = TypeVar("T")
C = TypeVar("C", bound=CollectionData)
#: Most shapes of a page. With so many it opens in seconds; matrix, map and tree grow with their square.
MOST_SHOWN = 600


def shown_part(collection: CollectionData) -> CollectionData:
    """Return the collection as far as a page shows it: all of it, or some shapes with a note that says so."""
    if len(collection) <= MOST_SHOWN:
        return collection
    numbers = {"num": MOST_SHOWN, "total": len(collection), "num_doubtful": MOST_SHOWN // 2}
    part = some_shapes(collection, chosen_shapes(collection, MOST_SHOWN))
    return replace(part, notes=(*collection.notes, Note("shown-in-part", values=numbers)))


def page_members(collection: CollectionData) -> list[IntArray]:
    """Return the shapes of each of the pages that show all: about as many on each, most pairs within a page.

    Shapes are ordered so that those that were matched and agree are near each other (Cuthill and McKee 1969).
    """
    num = len(collection)
    agreeing = [(pair.target, pair.source) for pair in collection.pairs if pair.inlier]
    ends = np.array(agreeing, dtype=np.int64).reshape(-1, 2)
    rows, cols = np.concatenate([ends, ends[:, ::-1]]).T
    graph = coo_array((np.ones(len(rows)), (rows, cols)), shape=(num, num)).tocsr()
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    num_pages = -(-num // MOST_SHOWN)
    return [np.sort(members) for members in np.array_split(order, num_pages)]


def some_shapes(collection: C, chosen: IntArray) -> C:
    """Return the collection as if there were only some of its shapes, given by position, ascending."""
    position = {int(shape): at for at, shape in enumerate(chosen)}
    names = tuple(collection.names[i] for i in chosen)
    return replace(
        collection,
        names=names,
        files=tuple(collection.files[i] for i in chosen),
        transforms=collection.transforms[chosen],
        confidence=collection.confidence[chosen],
        samples=collection.samples[chosen],
        positions=collection.positions[chosen],
        maps=ConsistentMaps(names=names, labels=collection.maps.labels[chosen]),
        landmarks=collection.landmarks[chosen],
        vertices=_of(collection.vertices, chosen),
        faces=_of(collection.faces, chosen),
        alternatives=tuple(collection.alternatives[i] for i in chosen),
        part_numbers=collection.part_numbers[chosen],
        labels={
            column: tuple(values[i] for i in chosen) for column, values in collection.labels.items()
        },
        pairs=tuple(
            replace(pair, target=position[pair.target], source=position[pair.source])
            for pair in collection.pairs
            if pair.target in position and pair.source in position
        ),
        incomplete=_chosen_incomplete(collection, position),
        places=_of(collection.places, chosen),
    )


def _of(meshes: tuple[T, ...], chosen: IntArray) -> tuple[T, ...]:
    """Return what belongs to the chosen shapes; nothing where there is nothing yet."""
    return tuple(meshes[i] for i in chosen) if meshes else ()


def _chosen_incomplete(
    collection: CollectionData, position: dict[int, int]
) -> tuple[Incomplete, ...]:
    """Return the incomplete shapes that are shown, with those of their partners that are."""
    chosen = []
    for one in collection.incomplete:
        kept = np.array([partner in position for partner in one.partners.tolist()], dtype=bool)
        if one.shape in position:
            shape = position[one.shape]
            partners = np.array([position[i] for i in one.partners[kept].tolist()], dtype=np.int64)
            chosen.append(replace(one, shape=shape, partners=partners, overlaps=one.overlaps[kept]))
    return tuple(chosen)


def chosen_shapes(collection: CollectionData, most: int) -> IntArray:
    """Return positions of the least confident shapes, half of ``most``, and of others evenly spaced; ascending."""
    order = np.argsort(np.nan_to_num(collection.confidence), kind="stable")
    doubtful, others = order[: most // 2], np.sort(order[most // 2 :])
    spaced = others[np.linspace(0, len(others) - 1, most - len(doubtful)).round().astype(np.int64)]
    return np.sort(np.concatenate([doubtful, spaced]))
