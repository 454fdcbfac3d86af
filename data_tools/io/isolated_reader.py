"""Reads shapes in a process of its own: a file that crashes, hangs or bloats its reader ends only that process.

The process is started once and reused: a file costs about 2 ms more than reading it here. Between the two travel JSON
and raw array bytes, which the parent checks like any input; nothing is unpickled, so that even a reader taken over by
a hostile file has no way to run anything here.
"""

from __future__ import annotations

import json
import os
import select
import signal
import struct
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import data_tools
from data_tools.errors import InputError
from data_tools.options import CleaningOptions
from data_tools.surface.shape import Shape

#: Length of the header that precedes every answer.
HEADER_LENGTH = struct.Struct("<Q")
_MAX_HEADER_BYTES = 2**20
_START_LIMIT_S = 60.0
#: What the process runs.
PROCESS_MODULE = "data_tools.io.reader_process"


class IsolatedReader:
    """Reads shapes in another process; use it with ``with``, and for many files.

    Parameters
    ----------
    time_limit_s : float
        For one file.
    memory_limit_bytes : int
        What reading may map beyond the idle process (Linux).

    Examples
    --------
    >>> with IsolatedReader(time_limit_s=10.0) as reader:  # doctest: +SKIP
    ...     shape = reader.read("tooth.ply")
    """

    def __init__(self, *, time_limit_s: float = 60.0, memory_limit_bytes: int = 4 * 2**30) -> None:
        self.time_limit_s = time_limit_s
        self.memory_limit_bytes = memory_limit_bytes
        self._process: subprocess.Popen[bytes] | None = None

    def read(self, path: str | Path, cleaning: CleaningOptions | None = None, *, name: str | None = None) -> Shape:
        """Read and clean a shape as :func:`data_tools.io.shapes.read_shape` does.

        Raises
        ------
        InputError
            As there, and if reading the file crashes its process or exceeds a limit.
        """
        path = Path(path)
        request = {"path": str(path.absolute()), "name": name, "cleaning": asdict(cleaning or CleaningOptions())}
        process = self._running()
        deadline = time.monotonic() + self.time_limit_s
        try:
            _send(process, request)
            header = _receive_header(process, deadline)
            if "error" in header:
                raise InputError(str(header["error"])[:2000])
            vertices = self._receive_array(process, header, "num_vertices", np.float64, deadline)
            faces = self._receive_array(process, header, "num_faces", np.int64, deadline)
        except TimeoutError:
            self._kill()
            raise InputError(f"{path}: reading took longer than {self.time_limit_s:g} s") from None
        except (EOFError, BrokenPipeError):
            raise InputError(f"{path}: its reader crashed ({self._how_it_ended()})") from None
        except (ValueError, KeyError, TypeError) as error:
            if isinstance(error, InputError):
                raise
            self._kill()
            raise InputError(f"{path}: its reader answered nonsense ({error})") from None
        notes = tuple(str(note) for note in header.get("notes", ()))
        return Shape.from_arrays(vertices, faces, name=str(header.get("name")), file=path, notes=notes)

    def close(self) -> None:
        """End the process."""
        self._kill()

    def __enter__(self) -> IsolatedReader:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self._kill()
            self._process = _start(self.memory_limit_bytes)
        return self._process

    def _receive_array(
        self, process: subprocess.Popen[bytes], header: dict[str, Any], field: str, dtype: type, deadline: float
    ) -> NDArray[Any]:
        rows = header[field]
        if isinstance(rows, bool) or not isinstance(rows, int) or not 0 <= rows * 24 <= self.memory_limit_bytes:
            raise ValueError(f"{field} = {rows!r}")
        return np.frombuffer(_receive(process, rows * 24, deadline), dtype=dtype).reshape(rows, 3)

    def _how_it_ended(self) -> str:
        process, self._process = self._process, None
        if process is None:
            return "no process"
        code = process.wait(timeout=_START_LIMIT_S)
        _close_pipes(process)
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            _close_pipes(process)


def _start(memory_limit_bytes: int) -> subprocess.Popen[bytes]:
    """Start the process and wait until it has imported its readers.

    Raises
    ------
    InputError
        If it does not come up.
    """
    package_parent = str(Path(data_tools.__file__).resolve().parents[1])
    search_path = os.pathsep.join([package_parent, *filter(None, [os.environ.get("PYTHONPATH")])])
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", PROCESS_MODULE, str(memory_limit_bytes)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": search_path, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    try:
        _receive_header(process, time.monotonic() + _START_LIMIT_S)
    except (EOFError, TimeoutError, ValueError) as error:
        process.kill()
        process.wait()
        _close_pipes(process)
        raise InputError(f"the process that reads files does not start ({type(error).__name__})") from None
    return process


def _send(process: subprocess.Popen[bytes], request: dict[str, Any]) -> None:
    assert process.stdin is not None
    process.stdin.write(json.dumps(request).encode() + b"\n")
    process.stdin.flush()


def _receive_header(process: subprocess.Popen[bytes], deadline: float) -> dict[str, Any]:
    (length,) = HEADER_LENGTH.unpack(_receive(process, HEADER_LENGTH.size, deadline))
    if length > _MAX_HEADER_BYTES:
        raise ValueError(f"a header of {length} bytes")
    header = json.loads(_receive(process, length, deadline))
    if not isinstance(header, dict):
        raise ValueError("a header that is no object")
    return header


def _receive(process: subprocess.Popen[bytes], size: int, deadline: float) -> bytes:
    """Return exactly ``size`` bytes, or raise EOFError or TimeoutError."""
    assert process.stdout is not None
    descriptor = process.stdout.fileno()
    parts: list[bytes] = []
    while size:
        ready, _, _ = select.select([descriptor], [], [], max(0.0, deadline - time.monotonic()))
        if not ready:
            raise TimeoutError
        part = os.read(descriptor, min(size, 2**20))
        if not part:
            raise EOFError
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _close_pipes(process: subprocess.Popen[bytes]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            try:
                pipe.close()
            except OSError:  # what was buffered for a dead process
                continue
