"""What every tool writes beside its files: command, version, date, options and templates."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from collalign.engine.command_line import COMMAND, now
from collalign.output.evidence.gather import json_types
from collalign.version import __version__
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder


def record_name(tool: str) -> str:
    """Return the name of the record of a tool, by which several of one folder differ."""
    return f"run-{tool.replace(' ', '-')}.json"


def write_tool_record(output: OutputFolder, tool: str, options: Mapping[str, Any]) -> None:
    """Stage the record of a tool.

    Parameters
    ----------
    output : OutputFolder
    tool : str
        The command, and the format if files of several may lie in one folder.
    options : mapping of str to Any
        What decided the files, templates included.
    """
    record = {"tool": tool, "command": COMMAND.get(), "version": __version__, "date": now(), "options": options}
    text = json.dumps(json_types(record), indent=1)
    write_atomic(output.stage(record_name(tool)), text.encode("utf-8", "backslashreplace"))
