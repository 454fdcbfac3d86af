"""Ways to synchronize planted pairs: this toolkit's, and others with the packages they need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from collalign.synchronization import synchronize
from collalign.synchronization.averaging import average_frames
from data_tools.arrays import FloatArray
from experiments.importable import is_importable
from experiments.peers.planted_pairs import Planted

#: Shonan averaging lifts rotations to matrices of this many rows. Its own search for a larger number ends without a
#: certificate wherever many pairs are wrong.
SHONAN_ROWS = 5

#: Takes a problem and the noise of right pairs per axis, radians; returns ``R_common_i``, (N, 3, 3), and confidences.
Synchronize = Callable[[Planted, float], tuple[FloatArray, FloatArray | None]]


@dataclass(frozen=True, kw_only=True)
class RotationTool:
    """A way to synchronize.

    Attributes
    ----------
    run : callable
    package : str
        What has to be installed; empty for nothing.
    """

    run: Synchronize
    package: str = ""

    @property
    def lacks(self) -> bool:
        """Whether its package cannot be imported."""
        return bool(self.package) and not is_importable(self.package)


def _best_candidates(problem: Planted) -> FloatArray:
    """Return the candidate of lowest energy of each pair, the first without energies, shape (E, 3, 3)."""
    if problem.energies is None:
        return problem.rotations[:, 0]
    return problem.rotations[np.arange(len(problem.edges)), np.argmin(problem.energies, axis=1)]


def _robust(problem: Planted, noise_rad: float) -> tuple[FloatArray, FloatArray | None]:
    found = synchronize(problem.edges, problem.rotations, energies=problem.energies)
    return found.rotations, found.confidence


def _spectral(problem: Planted, noise_rad: float) -> tuple[FloatArray, FloatArray | None]:
    return synchronize(problem.edges, _best_candidates(problem), method="spectral").rotations, None


def _reweighted(problem: Planted, noise_rad: float) -> tuple[FloatArray, FloatArray | None]:
    """Reweighted least squares of absolute deviations (Hartley et al. 2011, Chatterjee and Govindu 2013)."""
    start, _ = _spectral(problem, noise_rad)
    free = np.arange(len(start)) > 0
    measured = _best_candidates(problem)[:, None]
    frames = np.swapaxes(start, 1, 2)
    found = average_frames(frames, problem.edges, measured, np.ones((len(measured), 1)), free)
    return np.swapaxes(found, 1, 2), None


def _gtsam_gnc(problem: Planted, noise_rad: float) -> tuple[FloatArray, FloatArray | None]:
    """Graduated non-convexity of truncated least squares (Yang et al. 2020), which is given the noise."""
    import gtsam

    start, _ = _spectral(problem, noise_rad)
    noise = gtsam.noiseModel.Isotropic.Sigma(3, noise_rad)
    graph, initial = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorRot3(0, gtsam.Rot3(np.eye(3)), noise))
    for (i, j), rotation in zip(problem.edges.tolist(), _best_candidates(problem), strict=True):
        graph.add(gtsam.BetweenFactorRot3(i, j, gtsam.Rot3(rotation), noise))
    for i, rotation in enumerate(start[0].T @ start):
        initial.insert(i, gtsam.Rot3(rotation))
    parameters = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
    parameters.setLossType(gtsam.GncLossType.TLS)
    found = gtsam.GncLMOptimizer(graph, initial, parameters).optimize()
    return np.array([found.atRot3(i).matrix() for i in range(len(start))]), None


def _gtsam_shonan(problem: Planted, noise_rad: float) -> tuple[FloatArray, FloatArray | None]:
    """Shonan averaging with Huber's loss (Dellaert et al. 2020), from its own random start."""
    import gtsam

    noise = gtsam.noiseModel.Isotropic.Sigma(6, noise_rad)
    factors = gtsam.BetweenFactorPose3s()
    for (i, j), rotation in zip(problem.edges.tolist(), _best_candidates(problem), strict=True):
        factors.append(
            gtsam.BetweenFactorPose3(i, j, gtsam.Pose3(gtsam.Rot3(rotation), np.zeros(3)), noise)
        )
    parameters = gtsam.ShonanAveragingParameters3(gtsam.LevenbergMarquardtParams.CeresDefaults())
    parameters.setUseHuber(True)
    parameters.setCertifyOptimality(False)
    solver = gtsam.ShonanAveraging3(factors, parameters)
    found, _ = solver.run(solver.initializeRandomly(), SHONAN_ROWS, SHONAN_ROWS)
    return np.array([found.atRot3(i).matrix() for i in range(len(problem.truth))]), None


ROTATION_TOOLS: dict[str, RotationTool] = {
    "collalign": RotationTool(run=_robust),
    "eigenvectors": RotationTool(run=_spectral),
    "reweighted": RotationTool(run=_reweighted),
    "GTSAM, GNC": RotationTool(run=_gtsam_gnc, package="gtsam"),
    "GTSAM, Shonan": RotationTool(run=_gtsam_shonan, package="gtsam"),
}
