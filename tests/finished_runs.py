"""The collection of most whole runs, what is known of its files, and a finished run of any."""

import json

import numpy as np

from collalign import RunOptions, align_collection
from data_tools.datasets.synthetic import deformed_family, planted_collection, write_collection
from data_tools.datasets.synthetic_shapes import chair
from data_tools.poses import pose_angle_deg


def chairs(num, *, scale_range=(1.0, 1.0)):
    """Return a family of chairs in random poses."""
    rng = np.random.default_rng(5)
    family = deformed_family(chair(rng, resolution=1), num, rng, rms=0.02)
    return planted_collection(family, rng, scale_range=scale_range)


def angles_deg(frames):
    """Return the angle between any two poses (n, 3, 3), shape (n, n); 180 where only one of them mirrors."""
    return pose_angle_deg(frames[:, None], frames)


def radius(points):
    """Return the root mean square distance of points from their centroid."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


def on_files(planted, vertices):
    """Return where each file has some vertices of its family, shape (N, num, 3)."""
    places = [np.argsort(origin)[vertices] for origin in planted.origins]
    return np.stack([s.vertices[own] for s, own in zip(planted.shapes, places, strict=True)])


def slicer_file(path, points, labels):
    """Write a list of landmarks as 3D Slicer does, and return its path."""
    controls = [
        {"label": label, "position": point.tolist()}
        for label, point in zip(labels, points, strict=True)
    ]
    path.write_text(json.dumps({"markups": [{"type": "Fiducial", "controlPoints": controls}]}))
    return path


def made_once(function, key):
    """Return the function, which makes a result once for all calls of one ``key``."""
    known = {}

    def made(*arguments, **options):
        name = key(*arguments)
        if name not in known:
            known[name] = function(*arguments, **options)
        return known[name]

    return made


def finished_run(folder, planted, options, *, report=False):
    """Write a collection to ``folder/shapes``, align it, and return ``folder/out`` with the result and its store."""
    write_collection(folder / "shapes", planted)
    out = folder / "out"
    out.mkdir()
    run = RunOptions(jobs=1, store=out / "store.sqlite")
    align_collection(folder / "shapes", options=options, run=run, progress=False).save(
        out, report=report
    )
    return out
