"""Drawn faults that change no result, each with the reason; they do not count."""

from __future__ import annotations

#: By the text of the mutant.
EQUIVALENT: dict[str, str] = {}
