"""The certificates of a result: one file per pair with one, and the samples that they are about.

``certificates/3-7.npz`` is the certificate of the pair whose target and source are the shapes 3 and 7 in the order of
``alignment.json``; ``certificates/problems.npz`` holds the samples of all shapes as they were matched.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from collalign.products.pair import Pair
from collalign.products.run_record import Made
from data_tools.io.output_folder import OutputFolder

CERTIFICATE_FOLDER = "certificates"
PROBLEMS_FILE = "problems.npz"
#: What `collalign certify` leaves for others to check, and its name in the manifest of an output folder.
PROOF_FILE, CERTIFIER = "certification.npz", "certify"


def write_certificates(pairs: Sequence[Pair], made: Made, output: OutputFolder) -> None:
    """Stage the certificates of all pairs that have one, and the problems that they are about."""
    certified = [(pair, pair.certificate) for pair in pairs if pair.certificate is not None]
    for pair, certificate in certified:
        certificate.save(output.stage(CERTIFICATE_FOLDER, f"{pair.target}-{pair.source}.npz"))
    if certified:
        path = output.stage(CERTIFICATE_FOLDER, PROBLEMS_FILE)
        np.savez_compressed(path, coordinates=made.coordinates, invariants=made.invariants)
