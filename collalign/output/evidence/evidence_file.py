"""The files of a result that hold all of it: ``evidence.npz``, and the correspondences for other programs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from collalign.engine.store.records import to_arrays, to_record
from collalign.output.collection_data import CollectionData

#: Name of the file inside a result's folder.
EVIDENCE_FILE = "evidence.npz"
CORRESPONDENCES_FILE = "correspondences.npz"
#: Raised with every change that older readers cannot understand.
EVIDENCE_VERSION = 4
#: Fields of a collection that ``correspondences.npz`` has, and their names there.
CORRESPONDENCES = {"samples": "vertex_indices", "positions": "positions", "consensus": "consensus"}


def save_evidence(collection: CollectionData, folder: Path | str) -> Path:
    """Write ``evidence.npz`` into ``folder``; the same collection gives the same bytes.

    It holds the fields of :class:`collalign.Collection` by their names, all but those of ``correspondences.npz``.

    Parameters
    ----------
    collection : CollectionData
        With its display meshes, and its pairs as they are shown.
    folder : path
        Created if it does not exist.

    Returns
    -------
    Path
        The file written.
    """
    path = Path(folder) / EVIDENCE_FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    record = to_record(replace(collection, folder=None, fresh=None))
    arrays = to_arrays({name: record[name] for name in record if name not in {"maps", *CORRESPONDENCES}})
    np.savez_compressed(path, version=np.array(EVIDENCE_VERSION), **arrays)  # type: ignore[arg-type]
    return path


def save_correspondences(collection: CollectionData, folder: Path) -> None:
    """Write ``correspondences.npz`` into a folder."""
    np.savez_compressed(
        folder / CORRESPONDENCES_FILE,
        names=np.array(collection.names),
        labels=collection.maps.labels,
        **{there: getattr(collection, name) for name, there in CORRESPONDENCES.items()},
    )
