"""A file of a collection and where it stands, as it goes to a worker."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.arrays import FloatArray
from data_tools.io.shapes import read_shape
from data_tools.io.source import Origin
from data_tools.options import CleaningOptions
from data_tools.surface.shape import Shape


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedFile:
    """A file of a collection and where it stands.

    Attributes
    ----------
    name : str
    path : Origin
    digest : str
        Of the file's content, which is to be the same when it is read.
    transform : ndarray, shape (4, 4)
        File coordinates to the common frame.
    cleaning : CleaningOptions
    incomplete : bool
        Whether parts of the shape are missing, which are looked for then.
    """

    name: str
    path: Origin
    digest: str
    transform: FloatArray
    cleaning: CleaningOptions
    incomplete: bool = False

    def read(self, cleaning: CleaningOptions | None = None) -> Shape:
        """Return the shape in its own coordinates, cleaned as for the alignment or otherwise."""
        return read_shape(self.path, cleaning or self.cleaning, name=self.name, digest=self.digest)
