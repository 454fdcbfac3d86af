"""The result of an alignment as a user holds it: just made, or read from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

from collalign.engine.run_options import RunOptions
from collalign.output.browsing import Browsable
from collalign.output.evidence.evidence_file import load_view
from collalign.output.evidence.gather import part_numbers
from collalign.output.vertex_maps import VERTEX_MAPS_FILE, load_vertex_maps
from collalign.output.write import CORRESPONDENCES_FILE, MESH_FOLDER, WRITER, inputs_of, save_collection
from collalign.products.aligned_collection import Collection, ConsistentMaps
from collalign.products.evidence import CollectionView
from data_tools.arrays import IntArray, as_indices, read_only
from data_tools.errors import InputError
from data_tools.io.archives import load_arrays
from data_tools.io.output_folder import OutputFolder, file_stems
from data_tools.io.shapes import read_shape
from data_tools.io.source import location, read_source
from data_tools.options import AS_STORED
from data_tools.surface.shape import Shape
from data_tools.threads import one_blas_thread


class AlignedCollection(Browsable, Collection):
    """The result of :func:`collalign.align_collection`: a :class:`~collalign.products.aligned_collection.Collection`.

    ``len``, indexing and iteration give the shapes; notebooks show a table and a picture.
    """

    def _locations(self) -> tuple[str, ...]:
        return tuple(location(file) for file in self.files)

    def _part_numbers(self) -> IntArray:
        return part_numbers(self.parts, len(self))

    def _shape(self, at: int) -> Shape:
        return read_shape(self.files[at], self.options.cleaning, name=self.names[at], digest=self.digests[at])

    def _aligned_shape(self, at: int) -> Shape:
        return self._shape(at).transformed(self.transforms[at])

    def save(
        self,
        folder: str | Path,
        *,
        report: bool = True,
        labels: Mapping[str, tuple[str, ...]] | None = None,
        run: RunOptions | None = None,
    ) -> tuple[Path, ...]:
        """Write every output into ``folder``, all or nothing, and return the paths written.

        A file there that no earlier run wrote is never overwritten or deleted.

        Parameters
        ----------
        folder : str or Path
        report : bool
            Write ``report.html`` as well.
        labels : mapping of str to tuple of str, optional
            Columns of labels, one value per shape, for the report.
        run : RunOptions, optional
            Processes of this machine that share the work, for instance those of the alignment; by default this one
            alone.

        Raises
        ------
        InputError
            If the folder cannot be written, holds one of the shapes, lies inside of theirs, or holds somebody else's
            file under the name of an output.
        """
        with OutputFolder.open(folder, writer=WRITER, inputs=inputs_of(self.files)) as output:
            num_jobs = 1 if run is None else run.num_workers
            return save_collection(self, output, report=report, labels=labels, num_jobs=num_jobs)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LoadedCollection(Browsable, CollectionView):
    """A result that was read from its folder; see :func:`load`.

    ``len``, indexing and iteration give the shapes; notebooks show a table and a picture.

    Attributes
    ----------
    folder : Path
    """

    folder: Path

    def _locations(self) -> tuple[str, ...]:
        return self.files

    def _part_numbers(self) -> IntArray:
        return self.part_numbers

    def _shape(self, at: int) -> Shape:
        return Shape(name=self.names[at], vertices=self.vertices[at], faces=self.faces[at])

    def _aligned_shape(self, at: int) -> Shape:
        stem = file_stems(self.names)[at]
        return read_shape(self.folder / MESH_FOLDER / f"{stem}.ply", AS_STORED, name=self.names[at])

    @cached_property
    def maps(self) -> ConsistentMaps:  # type: ignore[override]  # read-only in both, by different means
        """Correspondences of samples, and of vertices where the result has them, read when first asked for.

        Raises
        ------
        InputError
            If the result's files of them are missing or damaged.
        """
        path = self.folder / CORRESPONDENCES_FILE
        data = load_arrays(read_source(path).content, path.name)
        if "labels" not in data:
            raise InputError(f"{path}: holds no labels of samples")
        labels = as_indices(data["labels"], f"{path}: labels", lower=-1, upper=2**31, shape=(len(self), None))
        has_vertices = (self.folder / VERTEX_MAPS_FILE).is_file()
        vertices = load_vertex_maps(self.folder) if has_vertices else None
        return ConsistentMaps(names=self.names, labels=read_only(labels), vertices=vertices)


@one_blas_thread()
def load(folder: str | Path) -> LoadedCollection:
    """Read the result that ``collalign align`` or :meth:`AlignedCollection.save` wrote.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    LoadedCollection

    Raises
    ------
    InputError
        If the folder holds no result, or a damaged one.

    Examples
    --------
    >>> import tempfile
    >>> points = np.random.default_rng(0).random((40, 3))
    >>> aligned = collalign.align_collection([points, points[::-1]], progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = aligned.save(folder)
    ...     collalign.load(folder)["shape2"].reflected
    False
    """
    view = load_view(folder)
    content = {field.name: getattr(view, field.name) for field in fields(view)}
    return LoadedCollection(**content, folder=Path(folder))
