"""Options that earlier versions had, and what takes their place; apart, so that the command line starts quickly."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from data_tools.errors import OptionsError

_CONSTANT = "it has one value now, that of its default"
_TWO_SHAPES = "it belongs to two shapes by themselves: `collalign match`, `pairwise.MatchOptions`"
#: Options of earlier versions, and what takes their place.
FORMER = {
    "landmarks": "large collections choose their pairs by themselves; see 'pairs'",
    "matching.seed": "a collection has one seed for everything; set 'seed' instead",
    "matching.certify": "set 'certify' instead",
    "matching.gap_tol": "proofs of a collection end at a gap of 1e-3",
    "embedding.wks_weight": "it was 0 by default; 'collalign maps' matches by the wave kernel signature",
    **{f"embedding.{name}": _CONSTANT for name in ("lb_weight", "boundary_weight", "open_factor")},
    **{f"sampling.{name}": _CONSTANT for name in ("seeds", "max_cloud_points")},
    **{
        f"matching.{name}": _TWO_SHAPES
        for name in (
            "num_rotations",
            "num_extreme_draws",
            "candidate_angle_deg",
            "estimate_scale",
            "scale_range",
            "estimate_translation",
        )
    },
}


def flat_names(table: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield the names of a table's options, those of its groups as ``group.name``."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from flat_names(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def refuse_former(names: Iterable[str]) -> None:
    """Refuse options of an alignment that earlier versions had.

    Raises
    ------
    OptionsError
        Naming what takes the option's place.
    """
    for name in names:
        if name in FORMER:
            raise OptionsError(f"{name}: not an option of collections any more; {FORMER[name]}")
