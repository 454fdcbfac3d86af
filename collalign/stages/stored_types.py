"""Preprocessed shapes and poses of pairs as records of the store, and back with every value checked.

What a record says is used only after its shapes, index ranges, finiteness and orthogonality have been checked, so
that a store made by somebody else can be wrong but not harmful. Names and timings are not part of a record: a shape's
record depends on the file's content alone, and a repeated run gives the same bytes.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from collalign.engine.store.records import Record
from collalign.products.pair import Pair
from collalign.stages.record_fields import (
    MAX_INDEX,
    checked,
    floats,
    indices,
    listed,
    number,
    positive,
    status,
    text,
)
from data_tools.arrays import (
    FloatArray,
    as_indices,
    as_points,
    as_rotations,
    read_only,
)
from data_tools.embedding.embedding import Samples
from data_tools.errors import InputError, SolveFailed
from pairwise.branch_and_bound.poses import PoseList
from pairwise.branch_and_bound.tilted import TiltedProof
from pairwise.certificates.certificate import Certificate
from pairwise.results import MatchResult

#: Most listed poses and regions of a pair: more candidates would make synchronization slow.
MOST_LISTED = 32

#: Of pairs that were matched without their dense samples.
_NO_GAPS = read_only(np.zeros(0))


def samples_to_record(samples: Samples) -> Record:
    """Return a preprocessed shape as a record, without its name."""
    return {
        "vertex_indices": samples.vertex_indices,
        "positions": samples.positions,
        "coordinates": samples.coordinates,
        "block_sizes": list(samples.block_sizes),
        "invariants": samples.invariants,
        "offset": samples.offset,
        "scale": float(samples.scale),
        "dense_indices": samples.dense_indices,
        "dense_positions": samples.dense_positions,
        "dense_normals": samples.dense_normals,
        "dense_invariants": samples.dense_invariants,
        "notes": list(samples.notes),
    }


def samples_from_record(record: Record, name: str) -> Samples:
    """Check a record and return the preprocessed shape.

    Parameters
    ----------
    record : dict
        From :func:`samples_to_record`, or anything else.
    name : str
        The shape's name in the present collection; also names it in the message.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"record of {name}"):
        positions = as_points(record["positions"], "positions", dim=3)
        k = len(positions)
        block_sizes = tuple(positive(size, "block_sizes") for size in listed(record["block_sizes"], "block_sizes"))
        if block_sizes[:1] != (3,) or len(block_sizes) > 2:
            raise InputError(f"block_sizes: expected (3,) or (3, m), got {block_sizes}")
        dense_indices = indices(record["dense_indices"], "dense_indices")
        scale = number(record["scale"], "scale")
        if not 0 < scale < np.inf:
            raise InputError(f"scale: expected a positive number, got {scale}")
        invariants = floats(record["invariants"], "invariants", (k, None))
        return Samples(
            name=name,
            vertex_indices=indices(record["vertex_indices"], "vertex_indices", num=k),
            positions=read_only(positions),
            coordinates=floats(record["coordinates"], "coordinates", (k, sum(block_sizes))),
            block_sizes=block_sizes,
            invariants=invariants,
            offset=floats(record["offset"], "offset", (3,)),
            scale=scale,
            dense_indices=dense_indices,
            dense_positions=floats(record["dense_positions"], "dense_positions", (len(dense_indices), 3)),
            dense_normals=_normals(record["dense_normals"], len(dense_indices)),
            dense_invariants=floats(
                record["dense_invariants"], "dense_invariants", (len(dense_indices), invariants.shape[1])
            ),
            notes=tuple(text(note, "notes") for note in listed(record["notes"], "notes")),
        )


def poses_to_record(result: MatchResult) -> Record:
    """Return the distinct poses of a match as a record, stacked along the first axis, the best one first.

    Raises
    ------
    SolveFailed
        If the match has no pose.
    """
    poses = result.candidates
    if not poses:
        raise SolveFailed(result.status.value, result)
    dim, num_points = result.R_target_source.shape[-1], len(result.map_target_source)
    rotations = np.array([pose.R_target_source for pose in poses], dtype=np.float64)
    maps = np.array([pose.map_target_source for pose in poses], dtype=np.int32)
    return {
        "rotations": rotations.reshape(len(poses), dim, dim),
        "maps": maps.reshape(len(poses), num_points),
        "energies": np.array([pose.energy for pose in poses], dtype=np.float64),
        "lower_bound": float(result.lower_bound),
        "status": result.status.name,
    }


def pair_from_record(record: Record, name: str, target: int = 0, source: int = 1) -> Pair:
    """Check a record of a pair's poses and return the pair.

    Parameters
    ----------
    record : dict
        From :func:`poses_to_record`, or anything else.
    name : str
        Names the pair in the message.
    target, source : int
        Positions of the shapes in the collection; by default one of two shapes.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"record of {name}"):
        energies = floats(record["energies"], "energies", (None,))
        num_poses = len(energies)
        rotations = as_rotations(floats(record["rotations"], "rotations", (num_poses, None, None)), "rotations")
        maps = as_indices(record["maps"], "maps", lower=-1, upper=MAX_INDEX, shape=(num_poses, None))
        if num_poses == 0:
            raise InputError("holds no pose")
        return Pair(
            target=target,
            source=source,
            rotations=read_only(rotations),
            maps=read_only(maps),
            energies=energies,
            gaps=floats(record["gaps"], "gaps", (num_poses,)) if "gaps" in record else _NO_GAPS,
            lower_bound=number(record["lower_bound"], "lower_bound", allow_nan=True),
            status=status(record["status"]).name,
        )


def proof_to_record(poses: PoseList, within: float) -> Record:
    """Return what was proven as a record; where there is a certificate, the bound is what that proves.

    Parameters
    ----------
    poses : PoseList
        At most :data:`MOST_LISTED` poses are kept, and the balls of the regions where the list is complete.
    within : float
        The factor of the best energy that they were asked for.
    """
    proof = poses.proof
    pose, certificate = proof.candidate, proof.certificate
    shape, size = pose.R_target_source.shape, len(pose.map_target_source)
    is_complete = poses.is_resolved and len(poses.regions) <= MOST_LISTED
    listed = poses.candidates[:MOST_LISTED]
    balls = [region.ball for region in poses.regions] if is_complete else []
    bound = proof.lower_bound if certificate is None else certificate.bound
    return {
        "lower_bound": float(min(bound, pose.energy)),
        "status": proof.status.name,
        "energy": float(pose.energy),
        "rotation": np.array(pose.R_target_source, dtype=np.float64),
        "map": np.array(pose.map_target_source, dtype=np.int32),
        "chirality_proven": bool(proof.is_chirality_proven),
        "certificate": None if certificate is None else asdict(certificate),
        "listed_rotations": np.array([one.R_target_source for one in listed]).reshape(-1, *shape),
        "listed_maps": np.array([one.map_target_source for one in listed], dtype=np.int32).reshape(-1, size),
        "listed_energies": np.array([one.energy for one in listed], dtype=np.float64),
        "complete_within": within if is_complete else float("nan"),
        "regions": np.array([centre for centre, _ in balls]).reshape(-1, *shape),
        "region_radii_rad": np.array([radius for _, radius in balls], dtype=np.float64),
    }


def proof_from_record(record: Record, name: str) -> Record:
    """Check a record of a proof and return its fields, as :func:`proof_to_record` names them.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"record of {name}"):
        if not isinstance(record["chirality_proven"], bool):
            raise InputError("chirality_proven: expected true or false")
        energies = floats(record["listed_energies"], "listed_energies", (None,))
        radii = floats(record["region_radii_rad"], "region_radii_rad", (None,))
        listed = floats(record["listed_rotations"], "listed_rotations", (len(energies), None, None))
        regions = floats(record["regions"], "regions", (len(radii), None, None))
        maps = as_indices(
            record["listed_maps"], "listed_maps", lower=-1, upper=MAX_INDEX, shape=(len(energies), None)
        )
        return {
            "lower_bound": number(record["lower_bound"], "lower_bound"),
            "status": status(record["status"]).name,
            "energy": number(record["energy"], "energy"),
            "rotation": read_only(as_rotations(record["rotation"], "rotation")),
            "map": indices(record["map"], "map"),
            "chirality_proven": record["chirality_proven"],
            "certificate": None if record["certificate"] is None else _certificate(record["certificate"]),
            "listed_rotations": read_only(as_rotations(listed, "listed_rotations")),
            "listed_maps": read_only(maps),
            "listed_energies": energies,
            "gap": number(record["gap"], "gap", allow_nan=True),
            "listed_gaps": floats(record["listed_gaps"], "listed_gaps", (len(energies),)),
            "complete_within": number(record["complete_within"], "complete_within", allow_nan=True),
            "regions": read_only(as_rotations(regions, "regions")),
            "region_radii_rad": radii,
        }


def tilted_to_record(proof: TiltedProof) -> Record:
    """Return what was found about a pair's energy less a linear function of its rotation as a record."""
    return {
        "lower_bound": float(proof.lower_bound),
        "rotations": np.array(proof.rotations, dtype=np.float64),
        "energies": np.array(proof.energies, dtype=np.float64),
    }


def tilted_from_record(record: Record, name: str) -> TiltedProof:
    """Check such a record and return what was found.

    Raises
    ------
    StoreError
        If a field is missing, of another shape, or impossible.
    """
    with checked(f"record of {name}"):
        energies = floats(record["energies"], "energies", (None,))
        rotations = as_rotations(floats(record["rotations"], "rotations", (len(energies), 3, 3)), "rotations")
        return TiltedProof(
            lower_bound=number(record["lower_bound"], "lower_bound"),
            rotations=read_only(rotations),
            energies=energies,
        )


def _certificate(fields: Any) -> Certificate:
    """Return a certificate whose fields have the right types; what it proves is its verifier's business."""
    if not isinstance(fields, dict) or fields.keys() != {"kind", "arrays", "problem_hash", "bound"}:
        raise InputError("certificate: expected kind, arrays, problem_hash and bound")
    if not isinstance(fields["arrays"], dict):
        raise InputError("certificate: its arrays are no mapping")
    if not all(isinstance(values, np.ndarray) for values in fields["arrays"].values()):
        raise InputError("certificate: one of its arrays is none")
    return Certificate(
        kind=text(fields["kind"], "kind"),
        arrays=fields["arrays"],
        problem_hash=text(fields["problem_hash"], "problem_hash"),
        bound=number(fields["bound"], "bound"),
    )


def _normals(value: Any, num: int) -> FloatArray:
    normals = floats(value, "dense_normals", (None, 3))
    if len(normals) not in (0, num):
        raise InputError(f"dense_normals: expected none or {num}, got {len(normals)}")
    return normals
