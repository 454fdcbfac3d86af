"""What a certification proved, in words and as ``certification.json`` beside the result."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from collalign.products.evidence import json_types
from collalign.products.joint_bound import CertifiedCollection, share_of
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder

#: The command whose file this is, in the manifest of an output folder.
WRITER = "certify"
JSON_FILE = "certification.json"
#: A shape that the cheapest known arrangement turns by more than this is posed otherwise there.
OTHERWISE_DEG = 20.0


def write_certification(certified: CertifiedCollection, output: OutputFolder) -> tuple[Path, ...]:
    """Write ``certification.json`` and return its path.

    Raises
    ------
    InputError
        If somebody else's file is in the way; nothing has been written then.
    """
    record = json_types(certification_record(certified))
    write_atomic(output.stage(JSON_FILE), json.dumps(record, indent=1).encode())
    return output.publish(complete=True)


def certification_record(certified: CertifiedCollection) -> dict[str, object]:
    """Return the contents of ``certification.json``."""
    joint = certified.joint
    return {
        "statement": list(certification_summary(certified)),
        "lower_bound": joint.bound,
        "sum_of_pair_bounds": float(joint.pair_bounds.sum()),
        "energy": {
            "stated": joint.stated_energy,
            "near": joint.near_energy,
            "perturbed": joint.perturbed_energy,
            "rounded": joint.rounded_energy,
            "cheapest_known": joint.energy,
        },
        "share": joint.share,
        "num_points": joint.num_points,
        "bound_of_each_round": joint.bounds,
        "ended": joint.ended,
        "shapes": [
            {"name": name, "R_cheapest_shape": frame, "change_deg": change, "same_chirality": same}
            for name, frame, change, same in zip(
                joint.names, joint.frames, certified.changes_deg, certified.same_chirality, strict=True
            )
        ],
        "pairs": [
            {"target": joint.names[i], "source": joint.names[j], "lower_bound": bound}
            for (i, j), bound in zip(joint.edges.tolist(), joint.pair_bounds, strict=True)
        ],
    }


def certification_summary(certified: CertifiedCollection) -> tuple[str, ...]:
    """Return what is proven, what the result has to do with it, and what is not proven, one sentence each."""
    joint = certified.joint
    turned = np.flatnonzero((certified.changes_deg > OTHERWISE_DEG) | ~certified.same_chirality)
    names = ", ".join(joint.names[i] for i in turned)
    near = share_of(joint.bound, joint.near_energy)
    own = (
        f"The poses of the result are those of that arrangement, up to {OTHERWISE_DEG:.0f} deg"
        if not len(turned)
        else f"The result poses {names} otherwise, which costs {joint.near_energy:.6g}"
    )
    return (
        f"Proven: no consistent arrangement of these {len(joint.names)} shapes costs less than "
        f"{_percent(joint.share)} of the cheapest one known ({joint.bound:.6g} of {joint.energy:.6g}, the sum over "
        f"{len(joint.edges)} pairs of squared distances of {joint.num_points} matched samples); the pairs' own "
        f"bounds prove {_percent(joint.pair_share)} ({joint.ended}).",
        f"{own}; no arrangement saves more than {_percent(1.0 - near)} of the energy next to the result.",
        "Not proven: that the poses are anatomically right, or that the cheapest poses are.",
    )


def _percent(share: float) -> str:
    return f"{100 * share:.2f} %"
