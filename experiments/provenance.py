"""Where figures come from: machine, versions, dates."""

from __future__ import annotations

import ast
import functools
import hashlib
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

#: Libraries whose version can change a figure; optional ones are left out where they are not installed.
LIBRARIES = (
    "collalign",
    "numpy",
    "scipy",
    "scs",
    "clarabel",
    "cvxpy",
    "trimesh",
    "potpourri3d",
    "robust-laplacian",
)
#: Folder of the packages.
ROOT = Path(__file__).resolve().parents[1]
#: The packages whose code decides what an alignment finds.
PRODUCT = ("collalign", "pairwise", "data_tools")
PEERS = ("open3d", "open3d-cpu", "gtsam", "kiss-matcher", "pyfmaps", "rustcpd", "small-gicp")


@functools.cache
def describe_machine() -> str:
    """Return processor, cores, memory and operating system in one line."""
    memory = (
        os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
        if hasattr(os, "sysconf")
        else 0.0
    )
    size = f", {memory:.0f} GiB" if memory else ""
    return f"{_processor()}, {os.cpu_count()} cores{size}, {platform.system()}"


def describe_versions() -> str:
    """Return the versions of Python and of the libraries that matter, in one line."""
    found = [f"Python {platform.python_version()}"]
    for name in (*LIBRARIES, *PEERS):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


@functools.cache
def code_digest(root: Path) -> str:
    """Return twelve hexadecimal digits that change with the product's code, and with no comment or docstring.

    Parameters
    ----------
    root : Path
        Folder of the packages.
    """
    found = hashlib.sha256()
    for package in PRODUCT:
        for file in sorted((root / package).rglob("*.py")):
            tree = ast.parse(file.read_text("utf-8"))
            for node in ast.walk(tree):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (
                    ast.get_docstring(node, clean=False) is not None
                ):
                    node.body[0] = ast.Pass()
            found.update(f"{file.relative_to(root).as_posix()}\0{ast.dump(tree)}\0".encode())
    return found.hexdigest()[:12]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
