"""``collalign certify``: how much cheaper any other arrangement could be at most, and the check of all proofs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from collalign.console.help import Flag
from collalign.console.interruption import resumable
from collalign.console.messages import add_to_summary, say, say_files
from collalign.console.running import Run
from collalign.engine.command_line import json_types
from collalign.engine.run_options import RunOptions
from collalign.output.certificates import CERTIFIER, PROOF_FILE
from collalign.output.collection import Collection
from collalign.output.evidence_file import save_evidence
from collalign.output.loading import load
from collalign.output.report.page import write_report
from collalign.output.verify import verify_result
from collalign.output.write import REPORT_FILE, WRITER, report_title
from collalign.products.trust import DOUBT
from collalign.tools.certify.result import CertifiedCollection, JointBound, share_of
from collalign.tools.certify.run import certify_collection
from collalign.wording import note_records, note_text
from data_tools.errors import InputError, OptionsError
from data_tools.io.output_folder import OutputFolder
from data_tools.io.source import inputs_of
from data_tools.notes import Note
from data_tools.poses import AGREE_DEG

JSON_FILE = "certification.json"
FILES = (JSON_FILE, PROOF_FILE)
#: How the codes of its notes begin.
_KIND = "arrangement-"


def write_certification(certified: CertifiedCollection, output: OutputFolder) -> tuple[Path, ...]:
    """Write ``certification.json`` and ``certification.npz`` and return their paths.

    Raises
    ------
    InputError
        If somebody else's file is in the way; nothing has been written then.
    """
    record, joint = json_types(certification_record(certified)), certified.joint
    output.stage_text(json.dumps(record, indent=1), JSON_FILE)
    np.savez_compressed(
        output.stage(PROOF_FILE),
        members=certified.members,
        coordinates=certified.coordinates,
        invariants=certified.invariants,
        edges=joint.edges,
        frames=joint.frames,
        bound=np.array(joint.bound),
        **dict[str, Any](joint.proof),
    )
    return output.publish(complete=True)


def tell_in_report(
    certified: CertifiedCollection, collection: Collection, result: Path
) -> tuple[Path, ...]:
    """Say what is proven of all shapes among the notes of a result and of its report; return what was written.

    Parameters
    ----------
    certified : CertifiedCollection
        Of a part of the shapes nothing is said there.
    collection : Collection
        The result, as its folder has it.
    result : Path
        This folder. What an earlier certification said there is replaced.
    """
    if len(certified.names) < len(collection):
        return ()
    kept = (note for note in collection.notes if not note.code.startswith(_KIND))
    collection = replace(collection, notes=(*kept, *certification_notes(certified)))
    with OutputFolder.open(result, writer=WRITER) as output:
        save_evidence(collection, output.staging)
        if (result / REPORT_FILE).is_file():
            write_report(collection, output.stage(REPORT_FILE), title=report_title(collection))
        return output.publish()


def certification_record(certified: CertifiedCollection) -> dict[str, object]:
    """Return the contents of ``certification.json``."""
    joint = certified.joint
    return {
        "statement": note_records(certification_notes(certified)),
        "lower_bound": joint.bound,
        "energy": {
            "stated": joint.stated_energy,
            "near": joint.near_energy,
            "cheapest_known": joint.energy,
        },
        "share": joint.share,
        "num_points": certified.coordinates.shape[1],
        "bound_of_each_round": joint.bounds,
        "ended": joint.ended,
        "shapes": [
            {
                "name": name,
                "R_cheapest_shape": frame,
                "change_deg": change,
                "same_chirality": same,
            }
            for name, frame, change, same in zip(
                certified.names,
                joint.frames,
                certified.changes_deg,
                certified.same_chirality,
                strict=True,
            )
        ],
        "pairs": [
            {"target": certified.names[i], "source": certified.names[j]}
            for i, j in joint.edges.tolist()
        ],
    }


def certification_notes(certified: CertifiedCollection) -> tuple[Note, ...]:
    """Return what is proven, what the result has to do with it, which shapes stay free, and what is not proven."""
    joint = certified.joint
    bound = {
        "num": len(certified.names),
        "gap": 1.0 - share_of(joint.bound, joint.near_energy),
        "unproven": 1.0 - joint.share,
        "bound": joint.bound,
        "result": joint.near_energy,
        "cheapest": joint.energy,
        "num_points": certified.coordinates.shape[1],
        "num_pairs": len(joint.edges),
        "ended": joint.ended,
    }
    return (
        Note(f"{_KIND}bound", values=bound),
        _own_note(certified),
        _free_note(joint),
        Note(f"{_KIND}scope"),
    )


def _own_note(certified: CertifiedCollection) -> Note:
    """Say whether the result is the cheapest arrangement known, and if not, whether it is in doubt there."""
    joint, names = certified.joint, certified.names
    rotated = np.flatnonzero((certified.changes_deg > AGREE_DEG) | ~certified.same_chirality)
    if not len(rotated):
        return Note(f"{_KIND}cheapest", values={"deg": AGREE_DEG})
    doubtful = tuple(names[i] for i in rotated if not certified.confidence[i] >= DOUBT)
    saving = 1.0 - share_of(joint.energy, joint.near_energy)
    return Note(
        f"{_KIND}refuted",
        tuple(names[i] for i in rotated),
        {"saving": float(saving), "doubtful": doubtful},
    )


def _free_note(joint: JointBound) -> Note:
    """Compare what is unproven with what the pairs of one shape cost: two of N shares of the energy, on average."""
    unproven, own = 1.0 - joint.share, 2.0 / len(joint.frames)
    if unproven >= own:
        return Note(f"{_KIND}free", values={"one": own})
    return Note(f"{_KIND}fixed", values={"times": unproven / own})


def certify(
    result: Path,
    *,
    shapes: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())] = (),
    budget_s: float | None = None,
    verify: Flag = False,
    run: Run = RunOptions(),  # noqa: B008
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
