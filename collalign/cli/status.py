"""``collalign status``: how far a run is, and what its store need not keep."""

from __future__ import annotations

from pathlib import Path

from collalign.console.help import Flag
from collalign.console.interruption import INCOMPLETE, UNFINISHED
from collalign.console.messages import add_to_summary, say
from collalign.engine.store import Store
from collalign.engine.store_file import FINISHED, NUM_FILES, STAGE, STORE_FILE
from collalign.output.evidence_file import EVIDENCE_FILE
from collalign.output.loading import load
from collalign.output.methods.paragraph import alignment_folder, methods_paragraph
from data_tools.errors import InputError, OptionsError, StoreError, printable


def status(result: Path, *, cite: Flag = False, prune: Flag = False) -> int:
    """Say how much of a run is done, failed and left; exit with 0 finished, 3 with something left out, 5 unfinished.

    Parameters
    ----------
    result
        The output folder of the run, or its store file where ``--store`` named another. With ``--cite`` also the
        folder of a tool: of ``transfer``, ``variation`` or ``export``.
    cite
        Print instead a paragraph for the methods section, from the alignment to what is in the folder, with figures,
        who was left out by whom, and references.
    prune
        Delete instead from a finished run's store what no run asked for last: other options, files that have changed
        or gone. The result stays as it is, and the same command computes nothing anew; a run with former options
        would.
    """
    if cite and prune:
        raise OptionsError("--cite and --prune: one at a time")
    if prune:
        return _prune(_store_of(result))
    if cite:
        is_alignment = result.is_file() or (result / EVIDENCE_FILE).is_file()
        paragraph = (
            methods_paragraph(load(result))
            if is_alignment
            else methods_paragraph(load(alignment_folder(result)), result)
        )
        say(paragraph)
        add_to_summary(methods=paragraph)
        return 0
    store = _store_of(result)
    with Store.open(store, read_only=True) as opened:
        counts, notes = opened.status(), opened.notes()
        failures = {kind: opened.failures(kind) for kind in counts}
    for kind, count in counts.items():
        failed = [{"label": one.label, "reason": one.reason} for one in failures[kind].values()]
        add_to_summary(**{kind: count | {"failures": failed}})
    num_files, stage = int(notes.get(NUM_FILES, 0)), notes.get(STAGE, FINISHED)
    if num_files > (planned := counts["shapes"]["planned"]):
        say(f"files: {num_files}, of which {num_files - planned} are duplicates")
    for kind, count in counts.items():
        if not count["planned"] and kind not in ("shapes", "pairs"):
            continue
        say(
            "{kind}: {done} done, {failed} failed, {left} left of {planned}".format(
                kind=kind, **count
            )
        )
        for failure in failures[kind].values():
            say(f"  {printable(failure.label)}: {failure.reason}")
    size = store.stat().st_size
    say(f"store: {size / 2**20:.1f} MiB")
    if stage != FINISHED:
        say(f"stage: {stage}")
    planned, left = (
        sum(count[state] for count in counts.values()) for state in ("planned", "left")
    )
    finished = stage == FINISHED and planned > 0 and not left
    add_to_summary(run=notes, store_bytes=size, finished=finished)
    if not finished:
        say("Not finished. If it no longer runs, the same command continues it.")
        return UNFINISHED
    return INCOMPLETE if counts["shapes"]["failed"] or counts["pairs"]["failed"] else 0


def _prune(store: Path) -> int:
    """Delete from a finished run's store what no run asked for last, and say how much that was."""
    with Store.open(store, read_only=True) as opened:
        if opened.notes().get(STAGE) != FINISHED:
            raise StoreError(
                f"{store}: the run is not finished; run the same command to go on, then prune"
            )
    before = store.stat().st_size
    with Store.open(store) as opened:
        removed = opened.prune()
    after = store.stat().st_size
    add_to_summary(removed=removed, store_bytes=after)
    say(
        f"{removed} records removed; store: {before / 2**20:.1f} MiB before, {after / 2**20:.1f} MiB now"
    )
    return 0


def _store_of(result: Path) -> Path:
    """Return the store of a run by its folder, or by itself.

    Raises
    ------
    InputError
        If a tool wrote the folder, or nothing did, or the store lies elsewhere.
    """
    store = result / STORE_FILE
    if not result.is_dir():
        return result
    if store.exists():
        return store
    if (result / EVIDENCE_FILE).is_file():
        raise InputError(
            f"{result}: the store of this result is not in it. Where --store named another file, ask for the status "
            "of that file"
        )
    raise InputError(
        f"{result}: this folder was written by a tool and has no run of its own. Ask for the status of its "
        f"alignment, {alignment_folder(result).resolve()}, or use --cite"
    )
