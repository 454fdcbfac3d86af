"""Runs ``collalign align`` as a process of its own: Slicer stays responsive, and a crash costs the run only."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

#: The package as pip knows it.
PACKAGE = "collalign"
#: Finished with something left out: there are results, and a note says what is missing.
FINISHED = (0, 3)


def command(
    python: str, folder: Path, out: Path, *, mirrored: str = "auto", keep_sizes: bool = False
) -> list[str]:
    """Return the command line.

    Parameters
    ----------
    python : str
        Slicer's Python (``PythonSlicer``).
    folder, out : Path
    mirrored : {"auto", "SO", "O"}
        Whether left and right specimens may be mixed.
    keep_sizes : bool

    Raises
    ------
    ValueError
        If ``folder`` is no folder, or the two contain one another.
    """
    folder, out = folder.resolve(), out.resolve()
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder")
    if out == folder or out in folder.parents or folder in out.parents:
        raise ValueError(
            f"{out}: choose an output folder that neither contains the shapes nor lies among them"
        )
    words = [python, "-m", PACKAGE, "align", str(folder), "--out", str(out), "--group", mirrored]
    return words + (["--scaling", "rigid"] if keep_sizes else [])


def run(words: list[str], report: Callable[[str], None]) -> bool:
    """Run the command and hand every line that it prints to ``report``; return whether there are results."""
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            report(line.rstrip())
    return process.returncode in FINISHED
