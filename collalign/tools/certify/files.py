"""What a certification proved, in words and as ``certification.json``, and what proves it, beside the result."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from collalign.output.certificates import PROOF_FILE
from collalign.output.evidence.evidence_file import save_evidence
from collalign.output.evidence.gather import json_types
from collalign.output.evidence.loading import load
from collalign.output.report.page import write_report
from collalign.output.write import REPORT_FILE, WRITER, report_title
from collalign.products.trust import DOUBT
from collalign.tools.certify.result import CertifiedCollection, JointBound, share_of
from data_tools.arrays import IntArray
from data_tools.io.files import read_text, write_atomic
from data_tools.io.output_folder import OutputFolder
from data_tools.percent import listed
from data_tools.poses import AGREE_DEG

JSON_FILE = "certification.json"
FILES = (JSON_FILE, PROOF_FILE)


def write_certification(certified: CertifiedCollection, output: OutputFolder) -> tuple[Path, ...]:
    """Write ``certification.json`` and ``certification.npz`` and return their paths.

    Raises
    ------
    InputError
        If somebody else's file is in the way; nothing has been written then.
    """
    record, joint = json_types(certification_record(certified)), certified.joint
    write_atomic(output.stage(JSON_FILE), json.dumps(record, indent=1).encode())
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


def tell_in_report(certified: CertifiedCollection, result: Path, former: Sequence[str]) -> tuple[Path, ...]:
    """Say what is proven of all shapes among the notes of a result and of its report; return what was written.

    Parameters
    ----------
    certified : CertifiedCollection
        Of a part of the shapes nothing is said there.
    result : Path
    former : sequence of str
        What an earlier certification said, which this replaces.
    """
    collection = load(result)
    if len(certified.names) < len(collection):
        return ()
    kept = (note for note in collection.notes if note not in former)
    collection = replace(collection, notes=(*kept, *certification_summary(certified)))
    with OutputFolder.open(result, writer=WRITER) as output:
        save_evidence(collection, output.staging)
        if (result / REPORT_FILE).is_file():
            write_report(collection, output.stage(REPORT_FILE), title=report_title(collection))
        return output.publish()


def former_statement(result: Path) -> list[str]:
    """Return what ``certification.json`` of a result says, nothing where there is none."""
    file = result / JSON_FILE
    return list(json.loads(read_text(file))["statement"]) if file.is_file() else []


def certification_record(certified: CertifiedCollection) -> dict[str, object]:
    """Return the contents of ``certification.json``."""
    joint = certified.joint
    return {
        "statement": list(certification_summary(certified)),
        "lower_bound": joint.bound,
        "energy": {"stated": joint.stated_energy, "near": joint.near_energy, "cheapest_known": joint.energy},
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
                certified.names, joint.frames, certified.changes_deg, certified.same_chirality, strict=True
            )
        ],
        "pairs": [{"target": certified.names[i], "source": certified.names[j]} for i, j in joint.edges.tolist()],
    }


def certification_summary(certified: CertifiedCollection) -> tuple[str, ...]:
    """Return what is proven, what the result has to do with it, and what is not proven, one sentence each."""
    joint, names = certified.joint, certified.names
    turned = np.flatnonzero((certified.changes_deg > AGREE_DEG) | ~certified.same_chirality)
    saving = 1.0 - share_of(joint.bound, joint.near_energy)
    less = _percent(1.0 - share_of(joint.energy, joint.near_energy))
    own = f"The poses of the result are those of the cheapest arrangement known, up to {AGREE_DEG:.0f} deg."
    if len(turned):
        own = f"Refuted: turning {listed([names[i] for i in turned])} costs {less} less. "
        own += _evidence(certified, turned)
    return (
        f"Proven: no consistent arrangement of these {len(names)} shapes is cheaper than the result by more than "
        f"{_percent(saving)}, nor than the cheapest one known by more than {_percent(1.0 - joint.share)} (lower "
        f"bound {joint.bound:.6g}, result {joint.near_energy:.6g}, cheapest {joint.energy:.6g}: the sum over "
        f"{len(joint.edges)} pairs of squared distances of {certified.coordinates.shape[1]} matched samples; "
        f"{joint.ended}).",
        own,
        _free(joint),
        "Not proven: that the poses are anatomically right, or that the cheapest poses are.",
    )


def _evidence(certified: CertifiedCollection, turned: IntArray) -> str:
    """Say whether the evidence, of which energies are a part only, lets shapes be turned."""
    doubtful = [certified.names[i] for i in turned if not certified.confidence[i] >= DOUBT]
    if not doubtful:
        return "Other evidence is for the poses of the result, of which none of these is in doubt."
    return f"Of these the result itself doubts {listed(doubtful)}: see R_cheapest_shape in {JSON_FILE}."


def _free(joint: JointBound) -> str:
    """Say what is unproven beside what the pairs of one shape cost: two of N shares of the energy, on average."""
    unproven, own = 1.0 - joint.share, 2.0 / len(joint.frames)
    if unproven >= own:
        return (
            f"Left free: every shape by itself, since what is unproven is more than one shape's pairs cost "
            f"({_percent(own)} on average)."
        )
    return (
        "Not asked: which single shapes this leaves free. What is unproven is "
        f"{unproven / own:.2g} of what the pairs of one shape cost on average."
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %"
