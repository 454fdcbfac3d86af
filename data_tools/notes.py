"""Notes: what a user must know about shapes or a result, as a code with fields; other modules put it into words.

Shares and lists of names are worded here, in one way wherever a person reads them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from data_tools.errors import InputError

#: What a field holds: a name, a number, or several of one kind.
Value: TypeAlias = str | int | float | tuple[str, ...] | tuple[int, ...] | tuple[float, ...]
_SCALARS = (str, int, float)


@dataclass(frozen=True)
class Note:
    """Something that a user must know.

    Attributes
    ----------
    code : str
        Which kind of note it is, such as ``duplicates-merged``; :mod:`collalign.wording` has the text of each.
    shapes : tuple of str
        Names of the shapes that it is about. Empty in the notes of one shape, and where it is about all.
    values : mapping of str to str, int, float or tuple of these
        The fields of the text. Tuples have one entry per shape where there are shapes.
    """

    code: str
    shapes: tuple[str, ...] = ()
    values: Mapping[str, Value] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        words = [*self.shapes, *(f"{name}={value}" for name, value in self.values.items())]
        return f"{self.code}: {', '.join(words)}" if words else self.code

    def record(self) -> dict[str, Any]:
        """Return the note in JSON types."""
        values = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in self.values.items()
        }
        return {"code": self.code, "shapes": list(self.shapes), "values": values}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Note:
        """Check a record and return the note; what else the record holds does not matter.

        Raises
        ------
        InputError
            If a field is missing or of another type.
        """
        if not isinstance(record, Mapping):
            raise InputError(f"note: expected a code with fields, got {type(record).__name__}")
        code, shapes, values = record.get("code"), record.get("shapes"), record.get("values")
        if not isinstance(code, str) or not isinstance(values, Mapping):
            raise InputError("note: code or values are missing")
        if not isinstance(shapes, list | tuple) or not all(
            isinstance(name, str) for name in shapes
        ):
            raise InputError(f"note {code}: shapes are no list of names")
        return cls(
            code,
            tuple(shapes),
            {str(name): _checked(code, value) for name, value in values.items()},
        )


def _checked(code: str, value: Any) -> Value:
    several = value if isinstance(value, list | tuple) else (value,)
    if not all(isinstance(one, _SCALARS) for one in several):
        raise InputError(f"note {code}: a value is neither a text nor a number")
    return tuple(several) if isinstance(value, list | tuple) else value


#: Names that a sentence lists; of more shapes the number is said.
MAX_NAMED = 8


def percent(share: float) -> str:
    """Return a share in [0, 1] as whole percent, rounded down: what is not certain is never called 100 %.

    ``"unknown"`` for NaN. The report's viewer rounds alike (``layers.js``).
    """
    return "unknown" if math.isnan(share) else f"{math.floor(100 * share + 1e-9)} %"


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence, shortened to :data:`MAX_NAMED`."""
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return ", ".join(names[:MAX_NAMED]) + more
