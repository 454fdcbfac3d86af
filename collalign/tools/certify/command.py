"""``collalign certify``: how much cheaper any other arrangement could be at most, and the check of all proofs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from collalign.console.help import Flag
from collalign.console.interruption import resumable
from collalign.console.messages import add_to_summary, say, say_files
from collalign.engine.run_options import RunOptions
from collalign.output.loading import load
from collalign.output.verification import CERTIFIER
from collalign.output.verify import verify_result
from collalign.tools.certify.files import (
    FILES,
    certification_notes,
    tell_in_report,
    write_certification,
)
from collalign.tools.certify.run import certify_collection
from collalign.wording import note_text
from data_tools.errors import InputError, OptionsError
from data_tools.io.output_folder import OutputFolder
from data_tools.io.source import inputs_of


def certify(
    result: Path,
    *,
    shapes: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())] = (),
    budget_s: float | None = None,
    verify: Flag = False,
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
) -> int:
    """Prove how much cheaper any other consistent arrangement of a result's shapes could be at most.

    Parameters
    ----------
    result
        Folder that ``collalign align`` wrote; certification.json and
        certification.npz, which --verify checks, are written into it, and what
        is proven of all shapes becomes a note of the result and its report.
    shapes
        Names of the shapes to certify; all by default.
    budget_s
        Seconds after which no further proof of a pair begins, an hour by default; pairs
        without one count with a bound that costs nothing.
    verify
        Prove nothing: check every certificate of the result, those of its pairs
        (``collalign align --certify``) and of the collection, without trusting
        the program that made them.
    """
    if verify:
        if shapes or budget_s is not None or run != RunOptions():
            raise OptionsError(
                "--verify checks all that is proven already; it takes no other option"
            )
        return _verify(result)
    budget: dict[str, Any] = {} if budget_s is None else {"budget_s": budget_s}
    collection = load(result)
    files = inputs_of(collection.source_files())
    with (
        resumable(run, result) as run,
        OutputFolder.open(result, writer=CERTIFIER, inputs=files) as output,
    ):
        output.refuse_foreign(FILES)
        found = certify_collection(collection, shapes=shapes, **budget, run=run)
        written = write_certification(found, output)
    written += tell_in_report(found, collection, result)
    for note in certification_notes(found):
        say(note_text(note))
    say_files(written)
    return 0


def _verify(result: Path) -> int:
    """Check every certificate of a result and print what each proves."""
    found = verify_result(result)
    add_to_summary(**found.as_dict())
    say(found.table())
    return 0 if found.holds else InputError.exit_code
