"""The dense stage: every posed shape registered to a mean surface, from maps of all vertices where there are any.

Maps alone are as exact where they are right, but only poses help where they are wrong, and for clouds and incomplete
shapes (``docs/tutorials/deformable.md`` has figures of both).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import scipy

from collalign.engine.job import Job, Results, Shared, Wanted, table_of_values
from collalign.engine.progress import progress_display
from collalign.engine.run_options import RunOptions
from collalign.engine.session import ProgressFactory, Session
from collalign.engine.store import fingerprint
from collalign.output.collection import Collection
from collalign.output.loading import load
from collalign.output.members import main_part
from collalign.products.consistent_maps import VertexMaps
from collalign.products.shapes import PosedFile
from collalign.registration.by_map import MapGoals, bent_by_map, unbent
from collalign.registration.register import Registration, register
from collalign.registration.surface import (
    RegistrationSurface,
    mean_of_what_is_there,
    missing_vertices,
    with_cloud_rim,
)
from data_tools.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    one_line,
    read_only,
    rms_length,
)
from data_tools.checks import as_options
from data_tools.embedding.working_surface import WorkingSurface
from data_tools.errors import CollectionError, InputError
from data_tools.options import SamplingOptions
from data_tools.poses import fitting_similarity, moved_by
from data_tools.surface.shape import Shape
from data_tools.surface.topology import boundary_edges
from data_tools.threads import one_blas_thread


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseCorrespondence:
    """The mean surface of a collection and where each of its vertices lies on every shape. Arrays are read-only.

    Attributes
    ----------
    names : tuple of str, length N
        Shapes that were registered.
    faces : ndarray of int, shape (f, 3)
        Triangles of the mean and of every shape's copy of it; empty for point clouds.
    mean : ndarray, shape (v, 3)
        In the common frame: the average of the copies, each where its shape is there; on no specimen.
    vertices : ndarray, shape (N, v, 3)
        The mean's vertices on each shape, in the common frame; NaN where an incomplete shape has nothing.
    completed : ndarray, shape (N, v, 3)
        The same, with what an incomplete shape lacks as the mean has it, bent as the rest of the shape asks: a guess.
    residual : ndarray, shape (N, v)
        Distance of each of them to the shape's surface, in units of the common frame; NaN where it has nothing.
    quality : ndarray, shape (N, v)
        Between 0 (no counterpart on the shape) and 1.
    failed : tuple of (str, str)
        Names of shapes that could not be registered, and why.
    """

    names: tuple[str, ...]
    faces: IntArray
    mean: FloatArray
    vertices: FloatArray
    completed: FloatArray
    residual: FloatArray
    quality: FloatArray
    failed: tuple[tuple[str, str], ...] = ()

    __repr__ = one_line

    @property
    def missing(self) -> BoolArray:
        """Where each shape has nothing, shape (N, v)."""
        return np.asarray(np.isnan(self.vertices).any(axis=2))


#: Changes whenever the same maps would start another registration.
START_VERSION = "map-start-1"
BothWays: TypeAlias = tuple[IntArray, IntArray]


def goals_of(onto: IntArray, back: IntArray, stored: Shape) -> MapGoals:
    """Return where a map takes the vertices of the registered surface.

    Parameters
    ----------
    onto : ndarray of int, shape (v,)
        The file's vertex for each vertex of the surface, -1 where there is none.
    back : ndarray of int, shape (w,)
        The surface's vertex for each vertex of the file.
    stored : Shape
        The posed shape with the vertices of its file.

    Raises
    ------
    InputError
        If the map is of a file with another number of vertices.
    """
    num = len(stored.vertices)
    if len(back) != num or onto.max(initial=-1) >= num:
        raise InputError(f"{stored.name}: its maps are of {len(back)} vertices, its file has {num}")
    forth, known = np.flatnonzero(onto >= 0), np.flatnonzero(back >= 0)
    return np.concatenate([forth, back[known]]), stored.vertices[
        np.concatenate([onto[forth], known])
    ]


def template_maps(
    maps: VertexMaps, reference: Shape, template: Shape, file_vertices: IntArray
) -> Mapping[str, BothWays]:
    """Return the maps between the template, one of the shapes, and all shapes that have maps.

    Parameters
    ----------
    maps : VertexMaps
    reference : Shape
        The template, with the vertices of its file.
    template : Shape
        The same, as it is registered: perhaps decimated.
    file_vertices : ndarray of int, shape (v,)
        The file's vertex for each of the template's.

    Returns
    -------
    mapping of str to ``onto`` and ``back`` of :func:`goals_of`
        By name; empty where the reference itself has no maps.
    """
    if reference.name not in maps.names:
        return {}
    nearest = np.append(scipy.spatial.cKDTree(template.vertices).query(reference.vertices)[1], -1)
    own = np.arange(len(reference.vertices))
    starts = {}
    for name in maps.names:
        onto, back = (
            (own, own)
            if name == reference.name
            else (maps[name, reference.name], maps[reference.name, name])
        )
        if len(onto) != len(own):
            raise InputError(
                f"{name}: its maps are of {len(onto)} vertices of {reference.name}, not {len(own)}"
            )
        starts[name] = onto[file_vertices], nearest[back]
    return starts


#: Registrations of the collection: from its medoid, and then from the mean of those. A third changes the error of
#: landmarks carried over by less than .5 % (eight mouse skulls).
NUM_MEAN_ROUNDS = 2
#: Larger meshes are decimated to so many triangles before they are registered.
MAX_MEAN_FACES = 25_000


def correspond(
    session: Session[None],
    files: Sequence[PosedFile],
    reference: int,
    maps: VertexMaps | None = None,
) -> DenseCorrespondence:
    """Register a reference to every shape, then the mean of what came out, and return the last round.

    Parameters
    ----------
    session : Session
    files : sequence of PosedFile
        In the order of the collection.
    reference : int
        The shape that lends its triangles to the mean, see :func:`collalign.tools.correspond.medoid`.
    maps : VertexMaps, optional
        Of a collection that deforms; registrations start from them.

    Raises
    ------
    CollectionError
        If fewer than two shapes can be registered.
    """
    source, file_vertices = posed_shape(files[reference])
    starts: Mapping[str, BothWays] = {}
    if maps is not None:
        starts = template_maps(maps, stored_shape(files[reference]), source, file_vertices)
    for _ in range(NUM_MEAN_ROUNDS):
        registered = _register_all(session, files, source, starts)
        found, failed = dict(registered), registered.failures
        if len(found) < 2:
            raise CollectionError(
                "; ".join(["fewer than two shapes could be registered", *failed.values()])
            )
        mean = _mean(list(found.values()), source, is_bent=bool(starts))
        source = Shape.from_arrays(mean, source.faces, name="mean")
    vertices, residual, quality, missing = (
        np.stack([getattr(one, part) for one in found.values()])
        for part in ("vertices", "residual", "quality", "missing")
    )
    return DenseCorrespondence(
        names=tuple(found),
        faces=source.faces,
        mean=source.vertices,
        failed=tuple(failed.items()),
        vertices=read_only(np.where(missing[..., None], np.nan, vertices)),
        completed=read_only(vertices),
        residual=read_only(np.where(missing, np.nan, residual)),
        quality=read_only(np.where(missing, 0.0, quality)),
    )


def _mean(found: Sequence[Registration], source: Shape, *, is_bent: bool) -> FloatArray:
    """Return the mean of registered copies of a source, each where its shape is there; if bent, unbent."""
    centred = source.vertices - source.vertices.mean(axis=0)
    copies = [one.unposed for one in found]
    return mean_of_what_is_there(
        unbent(source, copies) if is_bent else copies,
        [one.missing for one in found],
        source.vertices,
        rms_length(centred),
    )


def _register_all(
    session: Session[None],
    files: Sequence[PosedFile],
    source: Shape,
    starts: Mapping[str, BothWays],
) -> Results[str, Registration]:
    """Return the registrations of a source to every file, by name."""
    contents = {"vertices": source.vertices, "faces": source.faces}
    source_key = fingerprint(REGISTERING.version, contents)
    wanted = {}
    for file in files:
        start = starts.get(file.name)
        wanted[file.name] = Wanted(
            key=_key(file, source_key, start),
            label=file.name,
            arguments={
                "source": Shared(key="0", reader=RegistrationSurface),
                "target": file,
                "start": start,
            },
        )
    with table_of_values([RegistrationSurface.from_shape(source)]) as table:
        return session.compute(
            REGISTERING, wanted, time_limit_s=session.run.shape_time_limit_s, shared=table
        )


def _key(file: PosedFile, source_key: str, start: BothWays | None) -> str:
    settings = {
        "cleaning": file.cleaning,
        "suffix": file.path.suffix.lower(),
        "transform": file.transform,
        "incomplete": file.incomplete,
    }
    if start is not None:
        settings["start"] = fingerprint(
            START_VERSION, dict(zip(("onto", "back"), start, strict=True))
        )
    return REGISTERING.key(settings, file.digest, source_key)


def register_file(
    source: RegistrationSurface, target: PosedFile, start: BothWays | None
) -> Registration:
    """Register a source to one file, from where a map between both takes it if there is one; runs inside a worker."""
    shape, _ = posed_shape(target)
    surface = RegistrationSurface.from_shape(shape)
    if target.incomplete:
        surface = with_cloud_rim(surface)
    first, bent = source, None
    if start is not None:
        mean = Shape.from_arrays(source.vertices, source.faces, name="mean")
        bent = bent_by_map(shape, mean, goals_of(*start, stored_shape(target)))
    if bent is not None:
        first = RegistrationSurface.from_shape(Shape.from_arrays(bent, source.faces, name="mean"))
    found, _ = register(surface, first)
    if bent is not None:  # the pose lays the source onto its copy, wherever it was registered from
        pose = fitting_similarity(found.vertices, source.vertices, np.ones(len(source.vertices)))
        found = replace(found, pose=pose)
    return (
        replace(found, missing=missing_vertices(surface, found.vertices))
        if target.incomplete
        else found
    )


#: Registers a surface. The version changes whenever the same surfaces would give another registration.
REGISTERING = Job(kind="registrations", version="dense-11", run=register_file, reader=Registration)


def posed_shape(file: PosedFile) -> tuple[Shape, IntArray]:
    """Read a file, decimate it where it is large, and put it into the common frame.

    Returns
    -------
    shape : Shape
    file_vertices : ndarray of int, shape (v,)
        The file's vertex at, or nearest to, each of its vertices.
    """
    shape = file.read()
    working = WorkingSurface(shape, SamplingOptions(max_faces=MAX_MEAN_FACES))
    return working.shape.transformed(file.transform), shape.file_indices[working.to_original]


def stored_shape(file: PosedFile) -> Shape:
    """Read a file with all its vertices, anywhere those that are of no use, and put it into the common frame."""
    shape = file.read(file.cleaning.as_stored)
    vertices = np.nan_to_num(shape.file_vertices)
    return Shape.from_arrays(
        vertices, shape.file_indices[shape.faces], name=shape.name
    ).transformed(file.transform)


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
    >>> dense = collalign.maps.dense_correspondence("aligned")
    >>> dense.vertices.shape == (3, *dense.mean.shape)
    True
    """
    collection = load(result, sources=sources)
    members = [at for at in main_part(collection).tolist() if collection.names[at] not in leave_out]
    files = [collection.posed_file(at) for at in members]
    maps = collection.vertex_maps if collection.has_vertex_maps else None
    with Session.open(
        None, as_options("run", run, RunOptions), progress_display(progress)
    ) as session:
        return correspond(session, files, choose_template(files), maps)


def choose_template(files: Sequence[PosedFile]) -> int:
    """Return which of some shapes lends its triangles: in the middle of all, complete and without a rim if one is.

    The middle is that of the files' own vertices. Simplified surfaces have too few.
    """
    clouds: dict[int, FloatArray] = {}
    closed = []
    for at in [at for at, file in enumerate(files) if not file.incomplete] or range(len(files)):
        try:
            shape = files[at].read()
        except InputError:
            continue  # its registration fails as well, and says why
        every = -(-len(shape.vertices) // MAX_MEAN_FACES)
        clouds[at] = _of_unit_size(moved_by(files[at].transform, shape.vertices[::every]))
        if len(shape.faces) and not len(
            boundary_edges(shape.faces)
        ):  # the others may have something in a hole
            closed.append(len(clouds) - 1)
    return list(clouds)[medoid(list(clouds.values()), closed)] if clouds else 0


def _of_unit_size(cloud: FloatArray) -> FloatArray:
    """Return a posed shape centred and scaled: common sizes rest on few samples, by which the medoid would change."""
    centred = cloud - cloud.mean(axis=0)
    radius = rms_length(centred)
    return np.asarray(centred / radius if radius > 0 else centred)


def medoid(clouds: Sequence[FloatArray], candidates: Sequence[int] = ()) -> int:
    """Return which cloud (n, 3), of the candidates if there are any, has the least summed distance to all others.

    The distance of two posed clouds is the mean distance of points to the nearest of the other, both ways. The medoid
    is the best start for a mean: no shape is very far from it. Clouds should be far denser than the shapes differ:
    with 64 points, which of two middle skulls it is depends on where the points lie. Of several it is the first.
    """
    trees = [scipy.spatial.cKDTree(cloud) for cloud in clouds]
    num = max(_NUM_QUERIES // len(clouds), 1)
    queries = [cloud[:: max(len(cloud) // num, 1)] for cloud in clouds]
    one_way = np.array([[tree.query(points)[0].mean() for points in queries] for tree in trees])
    sums = (one_way + one_way.T).sum(axis=0)
    return min(candidates or range(len(clouds)), key=lambda at: float(sums[at]))
