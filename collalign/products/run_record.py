"""How a run went, and what it holds in memory in addition to its result."""

from __future__ import annotations

from dataclasses import dataclass, field

from collalign.products.consistent_maps import VertexMaps
from collalign.products.trust import Trust
from data_tools.arrays import FloatArray
from data_tools.io.source import Origin
from data_tools.notes import Note

#: What a run does before its stages and between them, and how its results are written, among the times.
REST, OUTPUTS = "rest", "outputs"


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """How a run went: what may differ between two runs with the same result.

    Attributes
    ----------
    times_s : dict of str to float
        Wall-clock seconds per stage, and what lay between them as ``rest``. In ``run.json`` also what writing took,
        as ``outputs``; of a command they add up to its whole time.
    versions : dict of str to str
        Of Python and of the libraries that the numbers depend on.
    num_reused : int
        Shapes and pairs that came out of the store.
    skipped : tuple of str
        Files of the folder that are no shapes.
    left_out : tuple of str
        Shapes that the user asked to leave out (``--exclude``).
    known : tuple of str
        Files that were to be added and whose content the collection has already, each with the shape that has it.
    command : str
        The command line; empty where Python called.
    date : str
        When it ended, in UTC.
    """

    times_s: dict[str, float] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    num_reused: int = 0
    skipped: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    known: tuple[str, ...] = ()
    command: str = ""
    date: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Made:
    """What a run knows of a result that it has just made; writing the result takes it.

    Attributes
    ----------
    files : tuple of Path or Source
        Where each shape was read from; a source in memory where it came from no file.
    coordinates, invariants : ndarray, shapes (N, k, d) and (N, k, m)
        The samples as they were matched: embedded, centred and scaled, and what no rotation changes.
    shape_notes : tuple of tuple of Note
        What was repaired or simplified in each shape before it was matched.
    trust : Trust or None
        The evidence behind the confidences; None where none was gathered.
    vertices : VertexMaps or None
        Maps of all vertices, where they were asked for (``options.deformable``).
    """

    files: tuple[Origin, ...]
    coordinates: FloatArray
    invariants: FloatArray
    shape_notes: tuple[tuple[Note, ...], ...]
    trust: Trust | None = None
    vertices: VertexMaps | None = None
