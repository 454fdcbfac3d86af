"""A reader process for tests that does what the name of a file says."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from data_tools.io import reader_process
from data_tools.io.shapes import read_shape
from data_tools.surface.shape import Shape

NONSENSE: dict[str, Any] = {
    "negative": {"name": "x", "num_vertices": -1, "num_faces": 0},
    "huge": {"name": "x", "num_vertices": 2**60, "num_faces": 0},
    "list": ["x"],
    "index": {"name": "index", "num_vertices": 3, "num_faces": 1},
}


def wild_read_shape(path: str, *arguments: Any, **options: Any) -> Shape:
    behaviour = Path(path).stem
    if behaviour == "segfault":
        ctypes.string_at(0)
    elif behaviour == "exit":
        os._exit(3)
    elif behaviour == "hang":
        time.sleep(60)
    elif behaviour == "fill":
        np.ones(2**28)
    elif behaviour == "raise":
        raise RecursionError("too deep")
    elif behaviour == "print":
        os.write(1, b"a library talks\n" * 100)
    return read_shape(path, *arguments, **options)


def wild_answer(answers: BinaryIO, header: dict[str, Any], *arrays: bytes) -> None:
    if header.get("name") in NONSENSE:
        header = NONSENSE[header["name"]]
        arrays = (np.zeros((3, 3)).tobytes(), np.array([0, 1, 9]).tobytes())
    send(answers, header, *arrays)


if __name__ == "__main__":
    send = reader_process._answer
    reader_process.read_shape = wild_read_shape
    reader_process._answer = wild_answer
    reader_process.main(int(sys.argv[1]))
