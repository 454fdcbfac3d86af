"""Aligns a collection of 3D shapes consistently, and says how far each pose can be trusted.

>>> import collalign
>>> collection = collalign.align_collection("folder_of_meshes")  # doctest: +SKIP
>>> collection.save("aligned")                                   # doctest: +SKIP
"""

import ast
import sys
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

__version__ = version("collalign")

#: The module of each name in the stub, imported when the name is first asked for: a worker process that needs one
#: module of the package starts in a fifth of the time.
_HOMES = {
    one.name: node.module
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(node, ast.ImportFrom) and node.module is not None
    for one in node.names
}
__all__ = sorted(_HOMES)

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
    return sorted({*_HOMES, "__version__", *(name.rpartition(".")[2] for name in _BESIDE)})
