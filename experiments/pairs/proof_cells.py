"""What is measured about proofs: one pair, and one tooth with others."""

from __future__ import annotations

import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from collalign.engine.records import Record
from data_tools.arrays import FloatArray
from data_tools.embedding.sampling import farthest_points
from experiments.collections.landmarked import TEETH_FOLDER
from experiments.datasets import Dataset, read_teeth
from experiments.experiment import Cell
from experiments.figures.planted import planted_problem
from pairwise.branch_and_bound.pose_lists import list_poses
from pairwise.branch_and_bound.prove import prove
from pairwise.certificates.verify import verify_certificate
from pairwise.local_search import minimise
from pairwise.problem import Problem
from pairwise.relaxations import solve_relaxation
from pairwise.results import Status
from pairwise.rotation_sets import random_rotations

#: Relative gap of the proofs.
TOL = 1e-3
#: PM-SDP stops at its next look at the bound after so many seconds.
LIMIT_S = 20.0
#: Within which factor of the best energy all poses are listed.
WITHIN = 1.2


def measure_problem(cell: Cell) -> Record:
    """Prove one pair, bound it by PM-SDP where asked, and try random starts."""
    settings = cell.settings
    problem = proof_problem(settings, cell.data)
    prove(
        planted_problem(np.random.default_rng(0), 5, 5, 3, noise=0.3)
    )  # loads what Numba compiled
    started = time.process_time()
    proof = prove(problem, tol=TOL)
    record: Record = {"s": time.process_time() - started, "cells": proof.num_cells}
    energy, rng = proof.candidate.energy, np.random.default_rng(settings["seed"])
    ends = minimise(problem, random_rotations(problem.dim, settings["starts"], rng)).energies
    record |= {
        "proven": proof.status is Status.PROVEN_OPTIMAL,
        "share": proof.lower_bound / energy,
        "below": int((ends < proof.lower_bound * (1.0 - 1e-9)).sum()),
    }
    if not settings["relax"]:
        return record
    certificate = prove(problem, tol=TOL, record=True).certificate
    if certificate is not None:
        record["verified"] = (
            verify_certificate(problem.target, problem.source, certificate) / energy
        )
    started = time.process_time()
    found = solve_relaxation(
        problem.target,
        problem.source,
        tol=TOL,
        time_limit_s=LIMIT_S,
        cross_products=problem.dim == 3,
        row_sums=False,
    )
    return record | {
        "pm-sdp_s": time.process_time() - started,
        "pm-sdp_share": found.lower_bound / energy,
    }


def measure_tooth(cell: Cell) -> Record:
    """Prove and list the pairs of one tooth with all later ones."""
    index, num = cell.settings["index"], cell.settings["num"]
    own = tooth_samples(cell.data, index, cell.settings["points"])
    rows = []
    for other in range(index + 1, num):
        problem = Problem.from_user(own, tooth_samples(cell.data, other, cell.settings["points"]))
        started = time.process_time()
        poses = list_poses(problem, within=WITHIN, tol=TOL)
        seconds = time.process_time() - started
        is_proven = poses.proof.status is Status.PROVEN_OPTIMAL and poses.is_resolved
        rows.append([seconds, float(is_proven), len(poses.regions), len(poses.candidates)])
    columns = np.array(rows).reshape(-1, 4).T
    return dict(zip(("s", "proven", "regions", "poses"), columns, strict=True))


def proof_problem(settings: dict[str, Any], data: Path) -> Problem:
    """Return the problem of a cell: ``kind`` "cube" or "teeth", ``num`` points, ``noise`` of the cube, ``seed``."""
    rng = np.random.default_rng(settings["seed"])
    if settings["kind"] == "cube":
        num = settings["num"]
        planted = planted_problem(rng, num, num, settings["dim"], noise=settings["noise"])
        target, source = (
            points - points.mean(axis=0) for points in (planted.target, planted.source)
        )
        return Problem.from_user(target, source)
    teeth = read_teeth(data / TEETH_FOLDER)
    pair = rng.choice(len(teeth), 2, replace=False)
    return Problem.from_user(*(tooth_samples(data, int(i), settings["num"]) for i in pair))


@lru_cache(maxsize=512)
def tooth_samples(data: Path, index: int, num: int) -> FloatArray:
    """Return Euclidean farthest points of a tooth, of unit size, right teeth mirrored to left ones."""
    teeth = _teeth(data)
    shape = teeth.shape(index)
    chosen = shape.vertices[farthest_points(shape, num, metric="euclidean")]
    centred = chosen - chosen.mean(axis=0)
    if teeth.chirality is not None and teeth.chirality[index] < 0:
        centred = centred * np.array([-1.0, 1.0, 1.0])
    return centred / np.linalg.norm(centred)


@lru_cache(maxsize=1)
def _teeth(data: Path) -> Dataset:
    return read_teeth(data / TEETH_FOLDER)
