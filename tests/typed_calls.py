"""Calls as users write them, for mypy alone: each misuse is a type error, and nothing else is.

``mypy`` of the project's settings checks this module. An ignore that is not needed is an error, so a misuse that is
no longer noticed is one as well.
"""

import numpy as np

import collalign
import pairwise

points = np.zeros((8, 3))


def right_calls() -> pairwise.MatchResult:
    """Call functions as they are documented."""
    collalign.align_collection(
        "bones", seed=1, jobs=2, group="O", sampling={"num_points": 32}, progress=False
    )
    collalign.align_collection("bones", candidates={("a", "b"): np.eye(3)}, options={"seed": 1})
    sampling = collalign.options.SamplingOptions(num_points=32)
    collalign.match_rigid(points, points, group="O", sampling=sampling, matching={"num_draws": 8})
    collalign.match_in_part("a.ply", "b.ply", sampling={"normalisation": "none"})
    collalign.maps.match_shapes("a.ply", "b.ply", orientation="any")
    pairwise.solve_relaxation(points, points, group="O")
    collalign.synchronize([(0, 1)], [np.eye(3)], energies=[0.1])
    collalign.landmarks.transfer_landmarks(
        "result", ["A.fcsv"], surface_points=100, curves=["RIM/A.fcsv"]
    )
    error: type[Exception] = collalign.errors.InputError
    assert issubclass(error, Exception)
    return pairwise.match(points, points, group="O", weights=np.ones(8), certify=True, num_draws=8)


def misuses() -> None:
    """Misspell keywords, put them on the wrong level, and give values of other kinds."""
    collalign.align_collection("bones", sede=1)  # type: ignore[call-arg]
    collalign.align_collection("bones", num_points=32)  # type: ignore[call-arg]
    collalign.align_collection("bones", group="both")  # type: ignore[arg-type]
    collalign.align_collection("bones", sampling={"num_pionts": 32})  # type: ignore[arg-type]
    collalign.align_collection("bones", seed="one")  # type: ignore[arg-type]
    collalign.match_rigid("a.ply", "b.ply", scaling="rigid")  # type: ignore[call-arg]
    collalign.maps.match_shapes("a.ply", "b.ply", orientation="mirrored")  # type: ignore[arg-type]
    pairwise.match(points, points, gruop="O")  # type: ignore[call-arg]
    collalign.synchronize([(0, 1)], [np.eye(3)], energy=[0.1])  # type: ignore[call-arg]
    collalign.landmarks.transfer_landmarks("result", ["A.fcsv"], curve_pionts=9)  # type: ignore[call-arg]
    collalign.AlignOptions(sed=1)  # type: ignore[call-arg]
    _ = collalign.load("result").rotation  # type: ignore[attr-defined]
