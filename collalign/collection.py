"""The result of an alignment, with the one method that reaches from it to the disk."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from collalign.output.write import WRITER, inputs_of, save_collection
from collalign.products.collection import Collection
from data_tools.io.output_folder import OutputFolder


class AlignedCollection(Collection):
    """The result of :func:`collalign.align_collection`: a :class:`~collalign.products.collection.Collection`."""

    def save(
        self, folder: str | Path, *, report: bool = True, labels: Mapping[str, tuple[str, ...]] | None = None
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

        Raises
        ------
        InputError
            If the folder cannot be written, holds one of the shapes, lies inside of theirs, or holds somebody else's
            file under the name of an output.
        """
        with OutputFolder.open(folder, writer=WRITER, inputs=inputs_of(self.files)) as output:
            return save_collection(self, output, report=report, labels=labels)
