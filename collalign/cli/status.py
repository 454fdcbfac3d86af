"""``collalign status`` and ``repair``: how far a run is, and what to do about a store with damaged records."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from collalign.engine.store.layout import FINISHED, NUM_FILES, STAGE, STORE_FILE
from collalign.engine.store.store import Store
from data_tools.errors import StoreError


def status(result: Path, *, as_json: Annotated[bool, Parameter(name="--json", negative=())] = False) -> int:
    """Say how much of a run is done, failed and left.

    Parameters
    ----------
    result
        The output folder of the run, or its store file where ``--store`` named another.
    as_json
        Print one JSON object instead of text.
    """
    store = result / STORE_FILE if result.is_dir() else result
    with Store.open(store, read_only=True) as opened:
        counts, notes = opened.status(), opened.notes()
        failures = {kind: opened.failures(kind) for kind in counts}
    if as_json:
        report = {
            kind: asdict(count)
            | {"failures": [{"label": f.label, "reason": f.reason} for f in failures[kind].values()]}
            for kind, count in counts.items()
        }
        print(json.dumps(report | {"run": notes}, indent=1))
        return 0
    num_files, stage = int(notes.get(NUM_FILES, 0)), notes.get(STAGE, FINISHED)
    if num_files > counts["shapes"].planned:
        print(f"files: {num_files}, of which {num_files - counts['shapes'].planned} hold what another one holds")
    for kind, count in counts.items():
        if not count.planned and kind not in ("shapes", "pairs"):
            continue
        print(f"{kind}: {count.done} done, {count.failed} failed, {count.left} left of {count.planned}")
        for failure in failures[kind].values():
            print(f"  {failure.label}: {failure.reason}")
    if stage != FINISHED:
        print(f"stage: {stage}")
    if stage != FINISHED or any(count.left for count in counts.values()):
        print("Not finished: if it does not run any more, run the same command to go on.")
    return 0


def repair(result: Path) -> int:
    """Discard the damaged records of a run; the next one makes them again.

    Parameters
    ----------
    result
        The output folder of the run, or its store file where ``--store`` named another.
    """
    store = result / STORE_FILE if result.is_dir() else result
    if not store.is_file():
        raise StoreError(f"{store}: there is no such store")
    with Store.open(store) as opened:
        discarded = opened.discard_damaged()
    for kind, labels in discarded.items():
        for label in labels:
            print(f"discarded from {kind}: {label}")
    num = sum(len(labels) for labels in discarded.values())
    print(f"{num} damaged records discarded; run the same command again to make them" if num else "No damage found.")
    return 0
