"""Commands of the command line, run in this process, and the records and tables that they write."""

import csv
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import NamedTuple

from collalign.cli import main


class Said(NamedTuple):
    """What a command printed."""

    out: str
    err: str


def run_command(*words, ends=0):
    """Run ``collalign`` with these words, paths among them; check its exit code, and return what it printed."""
    typed = [str(word) for word in words]
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        code = main(typed)
    said = Said(out.getvalue(), err.getvalue())
    sys.stdout.write(said.out)
    sys.stderr.write(said.err)
    assert code == ends, typed
    return said


def read_json(path):
    """Return what a file of JSON holds."""
    return json.loads(path.read_text("utf-8"))


def read_rows(path):
    """Return the rows of a table with a heading."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))
