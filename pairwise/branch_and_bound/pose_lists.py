"""Complete lists of poses: regions of rotations that provably hold every pose up to an energy.

The quasi-bound (:mod:`pairwise.branch_and_bound.bounds`) holds for every pose whose rotation is best for its own map,
not only for the optimum. So once all cells whose bound exceeds T are set aside, every such pose of energy at most T
lies in the others, whatever their size; they are split until they are small, and those that touch make a region.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
import scipy
from numpy.typing import ArrayLike

from data_tools.arrays import FloatArray, IntArray, read_only
from data_tools.errors import OptionsError
from data_tools.rotations import rotation_angles
from data_tools.threads import one_blas_thread
from pairwise.branch_and_bound.prove import (
    Proof,
    deadline_of,
    finish,
    make_certificate,
    searches_of,
)
from pairwise.branch_and_bound.search import RotationSearch
from pairwise.local_search import minimise
from pairwise.problem import Problem, ProblemArguments
from pairwise.results import Candidate

#: Cells of a region from whose rotations its best pose is sought.
_NUM_STARTS = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseRegion:
    """A region of a pose list: cells of rotations that touch each other and may hold poses.

    Attributes
    ----------
    rotations : ndarray, shape (m, d, d)
        The region lies in the union of balls around these.
    radii_rad : ndarray, shape (m,)
    reflected : bool
        Whether these are reflections.
    candidate : Candidate or None
        The best pose found inside; None where descent from the region led out of it: it may hold no pose at all.
    """

    rotations: FloatArray
    radii_rad: FloatArray
    reflected: bool
    candidate: Candidate | None

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre (d, d) and angle in radians of one ball that holds the region; the centre is its pose, if any."""
        centre = self.rotations[0] if self.candidate is None else self.candidate.R_target_source
        reach = rotation_angles(self.rotations, centre) + self.radii_rad
        return centre, float(min(reach.max(), np.pi))

    def holds(self, rotation: FloatArray) -> bool:
        """Return whether an orthogonal matrix (d, d) lies in the balls."""
        return bool((rotation_angles(self.rotations, rotation) <= self.radii_rad).any())


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseList:
    """All poses of a pair up to an energy.

    Attributes
    ----------
    regions : tuple of PoseRegion
        Together they hold every pose that is best for its own map and has at most ``energy``, the region of the best
        pose first and those without a known pose last.
    energy : float
        ``within`` times the best energy.
    is_resolved : bool
        Whether all cells became as small as was asked for; where time ran out the regions still hold every pose.
    proof : Proof
        Of the best pose.
    """

    regions: tuple[PoseRegion, ...]
    energy: float
    is_resolved: bool
    proof: Proof

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The best pose of each region that has one of at most ``energy``, best first."""
        found = [region.candidate for region in self.regions if region.candidate is not None]
        return tuple(c for c in found if c.energy <= self.energy)


@one_blas_thread()
def all_poses(
    target: ArrayLike,
    source: ArrayLike,
    *,
    within: float = 1.2,
    resolution_deg: float = 3.0,
    tol: float = 1e-3,
    time_limit_s: float | None = None,
    **problem_arguments: Unpack[ProblemArguments],
) -> PoseList:
    """List every pose of at most ``within`` times the best energy, provably completely.

    A pose is a rotation that is best for its own map (Procrustes); alternating minimisation ends in such poses only.

    Parameters
    ----------
    target, source : array_like, shapes (n, d) and (k, d)
        Points are rows, d = 2 or 3; k <= n.
    within : float
        At least 1.
    resolution_deg : float
        Cells are split until their radius is at most this.
    tol : float
        Relative gap at which the best pose counts as proven.
    time_limit_s : float, optional
        Stop about then; no limit by default.
    **problem_arguments
        The arguments of :func:`pairwise.match` that make the problem.

    Raises
    ------
    InputError, OptionsError
        If the arrays or the options are not as described.

    Examples
    --------
    >>> import numpy as np
    >>> points = np.random.default_rng(0).random((12, 3)) - 0.5
    >>> noisy = points + 0.05 * np.random.default_rng(1).standard_normal((12, 3))
    >>> poses = all_poses(points, noisy)
    >>> len(poses.regions), poses.regions[0].holds(np.eye(3)), poses.proof.status.name
    (1, True, 'PROVEN_OPTIMAL')
    """
    problem = Problem.from_user(target, source, **problem_arguments)
    return list_poses(
        problem, within=within, resolution_deg=resolution_deg, tol=tol, time_limit_s=time_limit_s
    )


@one_blas_thread()
def list_poses(
    problem: Problem,
    known: FloatArray | None = None,
    *,
    within: float = 1.2,
    resolution_deg: float = 3.0,
    tol: float = 1e-3,
    time_limit_s: float | None = None,
    record: bool = False,
) -> PoseList:
    """List poses as :func:`all_poses` does, from a checked problem and poses (m, d, d) that are known already.

    With ``record`` the proof of the best pose has a certificate.
    """
    if not (np.isfinite(within) and within >= 1.0):
        raise OptionsError(f"within: expected a number of at least 1, got {within}")
    if not 0.0 < resolution_deg <= 180.0:
        raise OptionsError(
            f"resolution_deg: expected more than 0 and at most 180, got {resolution_deg}"
        )
    deadline = deadline_of(tol, time_limit_s)
    searches = searches_of(problem, known, tol)
    for search in searches:
        search.collect(within, np.deg2rad(resolution_deg))
        search.run(deadline, min(other.energy for other in searches))
    is_resolved = time.monotonic() < deadline
    best = min(search.energy for search in searches)
    cells = [search.collected(best) for search in searches]
    proof = finish(searches, deadline)
    if record:
        proof = replace(proof, certificate=make_certificate(problem, searches))
    regions = [
        region
        for search, found in zip(searches, cells, strict=True)
        for region in _regions(search, *found.cells.balls(), found.bounds)
    ]
    regions.sort(key=lambda region: np.inf if region.candidate is None else region.candidate.energy)
    energy = within * proof.candidate.energy
    return PoseList(regions=tuple(regions), energy=energy, is_resolved=is_resolved, proof=proof)


def _regions(
    search: RotationSearch, rotations: FloatArray, radii: FloatArray, bounds: FloatArray
) -> list[PoseRegion]:
    """Return the regions of one chirality, each with the best pose that descent finds inside."""
    regions = []
    for members in _touching(rotations, radii):
        lowest = members[np.argsort(bounds[members], kind="stable")[:_NUM_STARTS]]
        starts = np.concatenate([rotations[lowest], search.rotation[None]])
        minima = minimise(search.problem, starts)
        angles = rotation_angles(minima.rotations[:, None], rotations[members])
        inside = np.flatnonzero((angles <= radii[members]).any(axis=1))
        candidate = None
        if len(inside):
            candidate = Candidate(
                R_target_source=read_only(minima.rotations[inside[0]] * search.signs),
                map_target_source=read_only(minima.maps[inside[0]].copy()),
                energy=float(minima.energies[inside[0]]),
                reflected=search.reflected,
                origin="complete list",
            )
        regions.append(
            PoseRegion(
                rotations=read_only(rotations[members] * search.signs),
                radii_rad=read_only(radii[members]),
                reflected=search.reflected,
                candidate=candidate,
            )
        )
    return regions


def _touching(rotations: FloatArray, radii: FloatArray) -> list[IntArray]:
    """Group balls whose cells may touch: the angle between the centres is at most the sum of the radii.

    Angles theta are chords 2 sqrt(2) sin(theta / 2) between the matrices in dimension 2 and 3.
    """
    if not len(radii):
        return []
    reach = 2.0 * np.sqrt(2.0) * np.sin(0.5 * min(2.0 * float(radii.max()), np.pi))
    pairs = scipy.spatial.cKDTree(rotations.reshape(len(rotations), -1)).query_pairs(
        reach * (1.0 + 1e-9), output_type="ndarray"
    )
    first, second = pairs[:, 0], pairs[:, 1]
    close = rotation_angles(rotations[first], rotations[second]) <= radii[first] + radii[second]
    graph = scipy.sparse.coo_array(
        (np.ones(int(close.sum())), (first[close], second[close])), shape=(len(radii), len(radii))
    )
    num, labels = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return [np.flatnonzero(labels == label) for label in range(num)]
