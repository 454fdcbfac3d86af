"""Generated collections as the report and the exports receive them, with everything known."""

from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from collalign.options import AlignOptions
from collalign.output.collection import Collection
from collalign.output.evidence_file import save_correspondences, save_evidence, save_run
from collalign.products.consistent_maps import ConsistentMaps
from collalign.products.pair import AlignedPair, Alternative
from collalign.products.run_record import RunRecord
from collalign.products.shapes import Excluded
from collalign.tools.transfer.result import PLACED, TransferredLandmarks
from data_tools.notes import Note
from data_tools.poses import each_moved_by

NUM_SAMPLES = 24


def bumpy_shapes(num_shapes, *, seed=0, subdivisions=2):
    """Bodies with three unequal axes and a few bumps that vary from shape to shape.

    Returns
    -------
    vertices : ndarray, shape (num_shapes, v, 3)
        In correspondence and in the common frame.
    faces : ndarray of int, shape (f, 3)
    """
    rng = np.random.default_rng(seed)
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    base = np.asarray(sphere.vertices)
    centres = Rotation.random(5, random_state=3).apply([0, 0, 1])
    heights = 0.25 + 0.1 * rng.standard_normal((num_shapes, 5))
    bumps = np.exp(-12 * (1 - base @ centres.T))
    radii = 1 + np.einsum("nb,vb->nv", heights, bumps)
    axes = np.array([1.0, 0.7, 0.45]) * (1 + 0.05 * rng.standard_normal((num_shapes, 1, 3)))
    return radii[..., None] * base * axes, np.asarray(sphere.faces)


def view_of(num_shapes=10, *, seed=0, num_missing=0, subdivisions=2):
    """A collection with a doubtful shape, a mirrored one, failed and wrong pairs, labels and exclusions."""
    rng = np.random.default_rng(seed)
    common, faces = bumpy_shapes(num_shapes, seed=seed, subdivisions=subdivisions)
    chosen = np.linspace(0, common.shape[1] - 1, NUM_SAMPLES).astype(np.int64)
    R = Rotation.random(num_shapes, random_state=seed).as_matrix()
    R[min(2, num_shapes - 1)] *= -1
    scales = rng.uniform(0.05, 20.0, num_shapes)
    shifts = rng.standard_normal((num_shapes, 3))
    transforms = np.tile(np.eye(4), (num_shapes, 1, 1))
    transforms[:, :3, :3] = scales[:, None, None] * R
    transforms[:, :3, 3] = shifts
    inverse = np.linalg.inv(transforms)
    raw = common @ np.swapaxes(inverse[:, :3, :3], 1, 2) + inverse[:, None, :3, 3]
    samples = raw[:, chosen].copy()
    for at in range(num_missing):
        samples[at % num_shapes, at % NUM_SAMPLES] = np.nan
    confidence = rng.uniform(0.96, 1.0, num_shapes)
    confidence[1] = 0.21
    half_turn = np.diag([1.0, -1.0, -1.0])
    kinds = tuple(f"taxon {'ABC'[at % 3]}" for at in range(num_shapes))
    labels = np.tile(np.arange(NUM_SAMPLES), (num_shapes, 1))
    labels[np.isnan(samples).any(axis=2)] = -1
    positions = each_moved_by(transforms, np.nan_to_num(samples))
    names = tuple(f"shape_{at:03d}" for at in range(num_shapes))
    return Collection(
        names=names,
        files=tuple(f"folder/{name}.ply" for name in names),
        transforms=transforms,
        confidence=confidence,
        samples=np.tile(chosen, (num_shapes, 1)),
        positions=positions,
        maps=ConsistentMaps(names=names, labels=labels),
        consensus=positions.mean(axis=0),
        landmarks=samples,
        vertices=tuple(raw),
        faces=(faces,) * num_shapes,
        pairs=_pairs(R, rng),
        alternatives=tuple(
            (Alternative(rotation=half_turn @ R[at], log_odds=0.7),) if at == 1 else ()
            for at in range(num_shapes)
        ),
        digests=tuple(f"{at:040x}" for at in range(num_shapes)),
        part_numbers=np.zeros(num_shapes, dtype=np.int64),
        labels={
            "taxon": kinds,
            "side": tuple("left" if at % 2 else "right" for at in range(num_shapes)),
        },
        excluded=(
            Excluded(
                file="folder/broken.ply",
                reason="no vertices: export it again from the program that made it",
            ),
        ),
        options=AlignOptions(),
        group="O",
        run=RunRecord(
            versions={"collalign": "0.1.0", "numpy": np.__version__},
            times_s={"read": 0.5, "pairs": 12.25},
        ),
        cycle_errors_deg=np.abs(rng.normal(0, 12, 400)),
        notes=(Note("doubtful", ("shape_001",)),),
    )


def transferred_of(view, labels, **fields):
    """Landmarks that a transfer placed on vertices of a collection, from all its shapes as templates."""
    points = np.stack([vertices[[5, 40, 80, 90]] for vertices in view.vertices])
    shape = points.shape[:2]
    nothing = np.full(shape, np.nan)
    placed = {
        "points": points,
        "radii": np.zeros(shape),
        "ellipsoids": np.full((*shape, 3, 3), np.nan),
        "status": ((PLACED,) * 4,) * len(view),
        "templates": view.names,
        "template_trust": np.ones(shape),
        "left_out_points": points + 0.1,
        "left_out_errors": nothing,
        "left_out_radii": nothing,
    }
    return TransferredLandmarks(names=view.names, labels=labels, **placed | fields)


def write_result(collection, folder):
    """Write what :func:`collalign.load` reads of a result, and return the path of the evidence."""
    folder.mkdir(parents=True, exist_ok=True)
    save_correspondences(collection, folder)
    save_run(collection.run, folder)
    return save_evidence(collection, folder)


def _pairs(R, rng):
    """All pairs; every seventh is wrong by a half turn, the very last one was stopped."""
    num = len(R)
    half_turn = np.diag([-1.0, -1.0, 1.0])
    pairs = []
    for i in range(num):
        for j in range(i + 1, num):
            wrong = len(pairs) % 7 == 3
            right = R[i].T @ R[j]
            poses = [right, half_turn @ right]
            energy = float(rng.uniform(0.5, 1.0))
            first, second = (poses[1], poses[0]) if wrong else (poses[0], poses[1])
            order = np.arange(NUM_SAMPLES)
            order[:2] = order[1::-1]
            pairs.append(
                AlignedPair(
                    target=i,
                    source=j,
                    rotations=np.array([first, second]),
                    maps=np.zeros((2, 0), dtype=np.int64),
                    energies=np.array([energy, 1.4 * energy]),
                    energy=energy,
                    lower_bound=0.9 * energy,
                    disagreement_deg=180.0 if wrong else float(rng.uniform(0, 15)),
                    inlier=not wrong,
                    choice=-1 if wrong else 0,
                    chirality_proven=not wrong,
                    status="LOCAL_OPTIMUM",
                    map_target_source=order if wrong else np.arange(NUM_SAMPLES),
                )
            )
    pairs[-1] = replace(
        pairs[-1],
        status="Time limit reached.",
        choice=-1,
        inlier=False,
        disagreement_deg=np.nan,
        energy=np.nan,
        map_target_source=np.full(NUM_SAMPLES, -1),
    )
    return tuple(pairs)
