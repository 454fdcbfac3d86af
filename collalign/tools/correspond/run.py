"""Dense correspondence of an aligned collection."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory, Session, progress_display
from collalign.output.collection import Collection
from collalign.output.evidence.loading import load
from collalign.output.evidence.members import main_part
from collalign.products.shapes import PosedFile
from collalign.tools.correspond.jobs import MAX_FACES, correspond
from collalign.tools.correspond.result import DenseCorrespondence
from data_tools.arrays import FloatArray
from data_tools.checks import as_options
from data_tools.errors import InputError
from data_tools.poses import moved_by
from data_tools.surface.topology import boundary_edges
from data_tools.threads import one_blas_thread

#: Points of all clouds together whose nearest points on each are looked up. With a tenth, two runs of ten mouse
#: skulls, on which it was chosen, took different ones of two that are as near to the middle.
_NUM_QUERIES = 30_000


@one_blas_thread()
def dense_correspondence(
    result: Collection | str | Path,
    *,
    leave_out: Iterable[str] = (),
    sources: str | Path | None = None,
    run: RunOptions | Mapping[str, Any] | None = None,
    progress: ProgressFactory | bool = True,
) -> DenseCorrespondence:
    """Lay one triangulation onto every shape of a result, by smooth registration from the poses.

    A mean surface, which belongs to no specimen, is made and registered to every shape: closest points both ways,
    normals, a Gaussian-process field, coarse to fine. What has no counterpart pulls nothing. See
    :func:`collalign.registration.register.register`. Where an incomplete shape has nothing, its vertices are NaN, and
    it does not count in the mean; a complete shape lends its triangles, as long as there is one.

    Parameters
    ----------
    result : Collection or path
        A result, or the folder that ``collalign align`` wrote. Of several parts of shapes, which are not aligned
        with each other, only the largest is registered.
    leave_out : collection of str
        Names of shapes that neither count in the mean nor are registered.
    sources : path, optional
        Folder that holds the original files now, where they have moved.
    run : RunOptions, optional
        With a store, finished registrations are kept.
    progress : bool or callable
        As in :func:`collalign.align_collection`.

    Raises
    ------
    InputError
        If the folder holds no result.
    UnavailableError
        If an original file is missing.
    CollectionError
        If fewer than two shapes can be registered.

    Examples
    --------
    >>> import tempfile
    >>> from data_tools.datasets.synthetic import demo_collection, write_collection
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = write_collection(folder + "/shapes", demo_collection(num=3, resolution=1))
    ...     files = collalign.align_collection(folder + "/shapes", progress=False).save(folder + "/result")
    ...     dense = collalign.dense_correspondence(folder + "/result", progress=False)
    >>> dense.vertices.shape == (3, *dense.mean.shape)
    True
    """
    collection = load(result, sources=sources)
    members = [at for at in main_part(collection).tolist() if collection.names[at] not in leave_out]
    files = [collection.posed_file(at) for at in members]
    maps = collection.vertex_maps if collection.has_vertex_maps else None
    with Session.open(None, as_options("run", run, RunOptions), progress_display(progress)) as session:
        return correspond(session, files, choose_template(files), maps)


def choose_template(files: Sequence[PosedFile]) -> int:
    """Return which of some shapes lends its triangles: in the middle of all, complete and without a rim if one is.

    The middle is that of the files' own vertices. Simplified surfaces have too few: of fourteen mouse skulls they
    chose another, and landmarks carried from one of them erred .215 mm instead of .189.
    """
    clouds: dict[int, FloatArray] = {}
    closed = []
    for at in [at for at, file in enumerate(files) if not file.incomplete] or range(len(files)):
        try:
            shape = files[at].read()
        except InputError:
            continue  # its registration fails as well, and says why
        every = -(-len(shape.vertices) // MAX_FACES)
        clouds[at] = _of_unit_size(moved_by(files[at].transform, shape.vertices[::every]))
        if len(shape.faces) and not len(boundary_edges(shape.faces)):  # the others may have something in a hole
            closed.append(len(clouds) - 1)
    return list(clouds)[medoid(list(clouds.values()), closed)] if clouds else 0


def _of_unit_size(cloud: FloatArray) -> FloatArray:
    """Return a posed shape centred and scaled: common sizes rest on few samples, by which the medoid would change."""
    centred = cloud - cloud.mean(axis=0)
    radius = float(np.sqrt((centred**2).sum(axis=1).mean()))
    return np.asarray(centred / radius if radius > 0 else centred)


def medoid(clouds: Sequence[FloatArray], candidates: Sequence[int] = ()) -> int:
    """Return the cloud, of the candidates if there are any, whose summed distances to all others are least.

    The distance of two posed clouds is the mean distance of points to the nearest of the other, both ways. The medoid
    is the best start for a mean: no shape is very far from it. Clouds should be far denser than the shapes differ:
    with 64 points, which of two middle skulls it is depends on where the points lie. Of several it is the first.
    """
    trees = [cKDTree(cloud) for cloud in clouds]
    num = max(_NUM_QUERIES // len(clouds), 1)
    queries = [cloud[:: max(len(cloud) // num, 1)] for cloud in clouds]
    one_way = np.array([[tree.query(points)[0].mean() for points in queries] for tree in trees])
    sums = (one_way + one_way.T).sum(axis=0)
    return min(candidates or range(len(clouds)), key=lambda at: float(sums[at]))
