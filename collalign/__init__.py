"""Aligns a collection of 3D shapes consistently, and says how far each pose can be trusted.

>>> import collalign
>>> collection = collalign.align_collection("folder_of_meshes")  # doctest: +SKIP
>>> collection.save("aligned")                                   # doctest: +SKIP
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collalign.align import align_collection
    from collalign.certify import certify_collection
    from collalign.collection import AlignedCollection, LoadedCollection, load
    from collalign.dense import dense_correspondence
    from collalign.engine.options import RunOptions
    from collalign.extend import add_to_collection
    from collalign.nonrigid import match_shapes
    from collalign.options import AlignOptions, TwoShapeOptions
    from collalign.partial import PartialMatch, match_in_part
    from collalign.products.joint_bound import CertifiedCollection
    from collalign.rigid import RigidMatch, match_rigid
    from collalign.stability import StabilityOptions, check_stability
    from collalign.stages.joint_bound import CertifyOptions
    from collalign.synchronization import synchronize
    from collalign.transfer import transfer_landmarks
    from collalign.variation import write_surface_variation

__version__ = version("collalign")

__all__ = [
    "AlignOptions",
    "AlignedCollection",
    "CertifiedCollection",
    "CertifyOptions",
    "LoadedCollection",
    "PartialMatch",
    "RigidMatch",
    "RunOptions",
    "StabilityOptions",
    "TwoShapeOptions",
    "add_to_collection",
    "align_collection",
    "certify_collection",
    "check_stability",
    "dense_correspondence",
    "load",
    "match_in_part",
    "match_rigid",
    "match_shapes",
    "synchronize",
    "transfer_landmarks",
    "write_surface_variation",
]

#: Imported when first asked for: a worker process that needs one module of the package starts in a fifth of the time.
_HOMES = {
    "AlignOptions": "collalign.options",
    "AlignedCollection": "collalign.collection",
    "CertifiedCollection": "collalign.products.joint_bound",
    "CertifyOptions": "collalign.stages.joint_bound",
    "LoadedCollection": "collalign.collection",
    "PartialMatch": "collalign.partial",
    "RigidMatch": "collalign.rigid",
    "RunOptions": "collalign.engine.options",
    "TwoShapeOptions": "collalign.options",
    "StabilityOptions": "collalign.stability",
    "add_to_collection": "collalign.extend",
    "align_collection": "collalign.align",
    "certify_collection": "collalign.certify",
    "check_stability": "collalign.stability",
    "dense_correspondence": "collalign.dense",
    "load": "collalign.collection",
    "match_in_part": "collalign.partial",
    "match_rigid": "collalign.rigid",
    "match_shapes": "collalign.nonrigid",
    "synchronize": "collalign.synchronization",
    "transfer_landmarks": "collalign.transfer",
    "write_surface_variation": "collalign.variation",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
