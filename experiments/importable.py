"""Which of the other tools' packages work on this machine."""

from __future__ import annotations

import functools
from importlib import import_module


@functools.cache
def is_importable(package: str) -> bool:
    """Return whether a package can be imported: it is installed, and so are the system's libraries that it loads."""
    try:
        import_module(package)
    except (ImportError, OSError):
        return False
    return True
