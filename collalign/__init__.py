"""Aligns a collection of 3D shapes consistently, and says how far each pose can be trusted.

>>> import collalign
>>> collection = collalign.align_collection("folder_of_meshes")  # doctest: +SKIP
>>> collection.save("aligned")                                   # doctest: +SKIP
"""

from importlib.metadata import version

from collalign.align import align_collection
from collalign.collection import AlignedCollection
from collalign.extend import add_to_collection
from collalign.nonrigid import match_shapes
from collalign.options import AlignOptions, RunOptions
from collalign.synchronization import synchronize

__version__ = version("collalign")

__all__ = [
    "AlignOptions",
    "AlignedCollection",
    "RunOptions",
    "add_to_collection",
    "align_collection",
    "match_shapes",
    "synchronize",
]
