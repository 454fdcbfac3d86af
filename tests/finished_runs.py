"""The collection of most whole runs, and a finished run of any."""

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
