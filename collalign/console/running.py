"""How a command runs. Apart from the help of commands, which imports nothing that computes."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from collalign.engine.run_options import RunOptions

#: Options that decide no result.
Run = Annotated[RunOptions, Parameter(name="*")]
