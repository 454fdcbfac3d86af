"""Aligns a collection of 3D shapes consistently, and says how far each pose can be trusted.

>>> import collalign
>>> collection = collalign.align_collection("folder_of_meshes")  # doctest: +SKIP
>>> collection.save("aligned")                                   # doctest: +SKIP
"""

import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collalign.align import align_collection
    from collalign.engine.run_options import RunOptions
    from collalign.extend import add_to_collection
    from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
    from collalign.options import AlignOptions, TwoShapeOptions
    from collalign.output.collection import Collection
    from collalign.output.evidence.loading import load
    from collalign.synchronization import synchronize
    from collalign.tools.certify.result import CertifiedCollection
    from collalign.tools.certify.rounds import CertifyOptions
    from collalign.tools.certify.run import certify_collection
    from collalign.tools.correspond.run import dense_correspondence
    from collalign.tools.match.in_part import PartialMatch, match_in_part
    from collalign.tools.match.nonrigid import match_shapes
    from collalign.tools.match.rigid import RigidMatch, match_rigid
    from collalign.tools.stability.run import StabilityOptions, check_stability
    from collalign.tools.transfer.run import transfer_landmarks
    from collalign.tools.variation.run import write_surface_variation

__version__ = version("collalign")

__all__ = [
    "AlignOptions",
    "CertifiedCollection",
    "CertifyOptions",
    "Collection",
    "NonrigidOptions",
    "PartialMatch",
    "RigidMatch",
    "RunOptions",
    "StabilityOptions",
    "SurfaceOptions",
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
    "CertifiedCollection": "collalign.tools.certify.result",
    "CertifyOptions": "collalign.tools.certify.rounds",
    "Collection": "collalign.output.collection",
    "NonrigidOptions": "collalign.nonrigid.map_options",
    "PartialMatch": "collalign.tools.match.in_part",
    "RigidMatch": "collalign.tools.match.rigid",
    "RunOptions": "collalign.engine.run_options",
    "SurfaceOptions": "collalign.nonrigid.map_options",
    "TwoShapeOptions": "collalign.options",
    "StabilityOptions": "collalign.tools.stability.run",
    "add_to_collection": "collalign.extend",
    "align_collection": "collalign.align",
    "certify_collection": "collalign.tools.certify.run",
    "check_stability": "collalign.tools.stability.run",
    "dense_correspondence": "collalign.tools.correspond.run",
    "load": "collalign.output.evidence.loading",
    "match_in_part": "collalign.tools.match.in_part",
    "match_rigid": "collalign.tools.match.rigid",
    "match_shapes": "collalign.tools.match.nonrigid",
    "synchronize": "collalign.synchronization",
    "transfer_landmarks": "collalign.tools.transfer.run",
    "write_surface_variation": "collalign.tools.variation.run",
}

#: The packages beside this one, also by names below its own, and what each is there.
_BESIDE = {
    "collalign.pairwise": "pairwise",
    "collalign.data_tools": "data_tools",
    "collalign.errors": "data_tools.errors",
}


class _Beside(MetaPathFinder, Loader):
    """Finds ``collalign.pairwise.status`` as the module ``pairwise.status`` itself: no class is there twice."""

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        for alias, name in _BESIDE.items():
            if f"{fullname}.".startswith(f"{alias}."):
                return ModuleSpec(fullname, self, loader_state=name + fullname.removeprefix(alias))
        return None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(str(spec.loader_state))
        spec.loader_state = module.__spec__  # the import system is about to replace it
        return module

    def exec_module(self, module: ModuleType) -> None:
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


if not any(isinstance(finder, _Beside) for finder in sys.meta_path):
    sys.meta_path.insert(0, _Beside())


def __getattr__(name: str) -> Any:
    if f"{__name__}.{name}" in _BESIDE:
        return import_module(f"{__name__}.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*__all__, "__version__", *(name.rpartition(".")[2] for name in _BESIDE)})
