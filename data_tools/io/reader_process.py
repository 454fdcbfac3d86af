"""The process behind :class:`data_tools.io.isolated_reader.IsolatedReader`: reads one file per line of its input."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from data_tools.errors import CollalignError
from data_tools.io.isolated_reader import HEADER_LENGTH
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions


def main(memory_limit_bytes: int) -> None:
    """Answer requests on standard input until it ends, which it does when the parent is gone."""
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)  # whatever a library prints must not end up among the answers
        limit_memory(memory_limit_bytes)
        _answer(answers, {"ready": True})
        for line in sys.stdin.buffer:
            _serve(answers, json.loads(line))


def limit_memory(num_bytes: int) -> None:
    """Let this process map ``num_bytes`` more than it has now, where the system can tell (Linux)."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:
        return
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = pages * os.sysconf("SC_PAGE_SIZE") + num_bytes
    resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))


def _serve(answers: BinaryIO, request: dict[str, Any]) -> None:
    try:
        shape = read_shape(request["path"], CleaningOptions(**request["cleaning"]), name=request["name"])
    except CollalignError as error:
        _answer(answers, {"error": str(error)})
        return
    except MemoryError:
        _answer(answers, {"error": f"{request['path']}: does not fit in memory"})
        return
    except Exception as error:
        text = " ".join(str(error).split())[:200]
        _answer(answers, {"error": f"{request['path']}: cannot be read ({type(error).__name__}: {text})"})
        return
    header = {
        "name": shape.name,
        "notes": list(shape.notes),
        "num_vertices": len(shape.vertices),
        "num_faces": len(shape.faces),
    }
    _answer(answers, header, shape.vertices.astype(np.float64).tobytes(), shape.faces.astype(np.int64).tobytes())


def _answer(answers: BinaryIO, header: dict[str, Any], *arrays: bytes) -> None:
    text = json.dumps(header).encode()
    answers.write(HEADER_LENGTH.pack(len(text)) + text)
    for array in arrays:
        answers.write(array)
    answers.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]))
