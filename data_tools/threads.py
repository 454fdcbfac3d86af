"""One thread for linear algebra: every numerical entry point limits it here.

The matrices here have tens or hundreds of rows. Shared out among threads, their products take longer than alone, many
times longer where other work keeps the cores busy, and their last bits depend on the number of threads. Work is
shared out over shapes and pairs instead.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]


class _Limits:
    """Sets libraries to one thread, and later back to what they had, whichever thread asks."""

    def __init__(self, libraries: list[Any]) -> None:
        self._former = [(library, library.get_num_threads()) for library in libraries]
        for library in libraries:
            _set_num_threads(library, 1)

    def undo(self) -> None:
        for library, num in self._former:
            _set_num_threads(library, num)


def _set_num_threads(library: Any, num: int) -> None:
    """Set a library's number of threads, also where threadpoolctl has another thread in charge of it."""
    take_charge = getattr(
        library, "clear_controlling_thread", None
    )  # OpenBLAS, threadpoolctl 3.8 and newer
    if take_charge is not None:
        take_charge(force=True)
    library.set_num_threads(num)
    if take_charge is not None:
        take_charge(force=True)


class _ThreadLimiter:
    """Counts who is inside: the first one in limits what the process shares, the last one out undoes it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._num_inside = 0
        self._num_modules = -1
        self._shared: list[Any] = []
        self._own: list[Any] = []
        self._limits: list[_Limits] = []

    def enter(self) -> _Limits:
        """Limit the shared libraries, and return the limits of those that count each thread's calls by themselves."""
        with self._lock:
            found_more = self._look_for_libraries()
            if found_more or self._num_inside == 0:
                self._limits.append(_Limits(self._shared))
            self._num_inside += 1
            return _Limits(self._own)

    def leave(self, own: _Limits) -> None:
        with self._lock:
            own.undo()
            self._num_inside -= 1
            while self._num_inside == 0 and self._limits:
                self._limits.pop().undo()

    def _look_for_libraries(self) -> bool:
        """Look for BLAS and OpenMP again if modules have been imported since, which may have brought others."""
        import scipy.linalg  # noqa: F401  # brings a BLAS of its own, which would come after the limits otherwise

        if len(sys.modules) == self._num_modules:
            return False
        self._num_modules = len(sys.modules)
        libraries = ThreadpoolController().lib_controllers
        self._own = [
            lib
            for lib in libraries
            if "openmp" in (lib.user_api, getattr(lib, "threading_layer", ""))
        ]
        self._shared = [lib for lib in libraries if lib not in self._own]
        return True


_LIMITER = _ThreadLimiter()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS and OpenMP to one thread, as a context or as a decorator (``@one_blas_thread()``).

    Limits may be nested and entered from several threads; the limits that the caller had come back when the last one
    is left.
    """
    own = _LIMITER.enter()
    try:
        yield
    finally:
        _LIMITER.leave(own)
