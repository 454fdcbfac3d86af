"""``collalign verify``: the certificates of a finished result."""

from __future__ import annotations

from pathlib import Path

from collalign.cli.talk import say, tell
from collalign.output.verify import verify_result
from data_tools.errors import InputError


def verify(result: Path) -> int:
    """Check every certificate of a result, without trusting the program that made it.

    Parameters
    ----------
    result
        Folder that ``collalign align --certify`` wrote.
    """
    found = verify_result(result)
    tell(**found.as_dict())
    say(found.table())
    return 0 if found.holds else InputError.exit_code
