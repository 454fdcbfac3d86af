"""On which collections constants of the toolkit were chosen: what is measured on these is not held out."""

from __future__ import annotations

from collections.abc import Iterable

#: Collections that constants were chosen on, and which, by name of the collection.
SEEN = {
    "teeth": (
        "the 116 molars (weights of the invariants, dense stage, sides of specimens, confidence, incomplete shapes, "
        "registration)"
    ),
    "shrec07": (
        "the classes of SHREC07 (weights of the invariants, dense stage, when maps are asked for, how they judge "
        "poses and where they start, averages of bent poses, confidence)"
    ),
    "capod": (
        "CAPOD (powers of energy and mismatch in the costs of candidates, with fifteen other classes and without any "
        "left out; the local margin in the confidence, with each class left out)"
    ),
    "scape": "SCAPE (maps, when maps are asked for)",
}


def seen_note(collections: Iterable[str]) -> str:
    """Return the sentence that marks figures on collections of :data:`SEEN`."""
    listed = "; ".join(SEEN[name] for name in collections)
    return f"**Not held out.** Constants of the toolkit were chosen while looking at {listed}."
