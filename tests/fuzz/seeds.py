"""Small good files of every kind that the project reads, to be damaged."""

import numpy as np

from collalign.engine.store.keys import fingerprint
from collalign.engine.store.records import encode
from collalign.engine.store.store import Store
from collalign.engine.store.typed import to_record
from collalign.stages.pairs.match import match_pair
from data_tools.datasets.synthetic_shapes import crown
from data_tools.embedding.embedding import sample_shape
from data_tools.io.shapes import WRITABLE, write_mesh
from data_tools.options import SamplingOptions
from data_tools.surface.shape import Shape
from pairwise import solve_relaxation
from pairwise.options import MatchOptions

CONFIG = """
group = "O"
pairs = "sparse"
seed = 3
reference = "a"
[sampling]
num_points = 24
metric = "euclidean"
[embedding]
hks_weight = 0.1
[matching]
strategy = "portfolio"
"""


def shape_files(folder):
    """Return files of every readable format by name; the formats that are not written here are spelt out."""
    mesh = crown(np.random.default_rng(0), num_vertices=80)
    for suffix in WRITABLE:
        write_mesh(folder / f"mesh{suffix}", mesh)
    write_mesh(folder / "cloud.ply", Shape.from_arrays(mesh.vertices))
    np.savez(folder / "mesh.npz", vertices=mesh.vertices, faces=mesh.faces)
    points = mesh.vertices
    rows = [" ".join(f"{x:.6f}" for x in point) for point in points]
    (folder / "points.xyz").write_text("\n".join(rows))
    (folder / "points.txt").write_text("\n".join(rows))
    (folder / "points.csv").write_text("x,y,z\n" + "\n".join(row.replace(" ", ",") for row in rows))
    ascii_ply = "ply\nformat ascii 1.0\n" + f"element vertex {len(points)}\n"
    ascii_ply += "property float x\nproperty float y\nproperty float z\n" + f"element face {len(mesh.faces)}\n"
    ascii_ply += "property list uchar int vertex_indices\nend_header\n" + "\n".join(rows) + "\n"
    (folder / "ascii.ply").write_text(ascii_ply + "\n".join(f"3 {a} {b} {c}" for a, b, c in mesh.faces) + "\n")
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in points[mesh.faces]
    )
    (folder / "ascii.stl").write_text(f"solid a\n{facets}endsolid a\n")
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def records():
    """Return the record of a shape and of a pair."""
    samples = _samples()
    return {"shape.record": encode(to_record(samples[0])), "pair.record": encode(_pair(samples))}


def _pair(samples):
    return to_record(match_pair(samples[0], samples[1], "SO", MatchOptions()))


def _samples():
    options = SamplingOptions(num_points=8, num_dense_points=9)
    return [sample_shape(crown(np.random.default_rng(i), num_vertices=80), options) for i in range(2)]


def store_file(folder):
    """Return a store with shapes, pairs, a failure, a plan and options."""
    path = folder / "seed.store"
    samples = _samples()
    keys = [fingerprint("1", {}, str(i)) for i in range(3)]
    with Store.open(path) as store:
        for key, item in zip(keys, samples, strict=False):
            store.put("shapes", key, to_record(item), label=item.name, seconds=0.1)
        store.put("pairs", keys[0], _pair(samples), label="a - b")
        store.put_failure("pairs", keys[1], "took too long", label="a - c", crashed=True)
        store.plan("pairs", dict.fromkeys(keys, "pair"))
    return path.read_bytes()


def certificate_problem():
    """Return the target and source of :func:`certificate_file`."""
    rng = np.random.default_rng(1)
    return rng.standard_normal((5, 3)), rng.standard_normal((5, 3))


def certificate_file(folder):
    """Return a certificate of a small problem."""
    certificate = solve_relaxation(*certificate_problem(), max_iterations=50).certificate
    if certificate is None:
        raise RuntimeError("the relaxation gave no certificate")
    certificate.save(folder / "seed.npz")
    return (folder / "seed.npz").read_bytes()
