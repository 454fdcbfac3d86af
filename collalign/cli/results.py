"""``collalign verify``: the certificates of a finished result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.output.verify import verify_result
from data_tools.errors import InputError


def verify(
    result: Path,
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Check every certificate of a result, without trusting the program that made it.

    Parameters
    ----------
    result
        Folder that ``collalign align --certify`` wrote.
    as_json
        Print one JSON object instead of a table.
    """
    found = verify_result(result)
    print(json.dumps(found.as_dict(), indent=1) if as_json else found.table())
    return 0 if found.holds else InputError.exit_code
