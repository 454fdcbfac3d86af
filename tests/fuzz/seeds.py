"""Small good files of every kind that the project reads, to be damaged."""

import base64
import json
import struct

import numpy as np

from collalign.engine.records import encode, to_record
from collalign.engine.store import Store, fingerprint
from collalign.stages.match_pairs import match_pair
from data_tools.datasets.synthetic_shapes import crown
from data_tools.embedding.embedding import sample_shape
from data_tools.io.shapes import WRITABLE, write_mesh
from data_tools.options import SamplingOptions
from data_tools.surface.shape import Shape
from pairwise import solve_relaxation
from pairwise.options import MatchOptions
from tests.data_tools import test_landmark_files as one
from tests.data_tools import test_landmark_tables as several
from tests.data_tools.io.formats import test_gltf as gltf
from tests.data_tools.io.formats import test_pcd as pcd
from tests.data_tools.io.formats import test_vtk_legacy as vtk
from tests.data_tools.io.formats import test_vtp as vtp

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
    (folder / "points.asc").write_text("\n".join(rows))
    (folder / "points.txt").write_text("\n".join(rows))
    (folder / "points.csv").write_text("x,y,z\n" + "\n".join(row.replace(" ", ",") for row in rows))
    more = {
        "atoms.xyz": f"{len(rows)}\n\n"
        + "".join(f"{6 + at % 3} {row}\n" for at, row in enumerate(rows)),
        "named.xyz": f"{len(rows)}\nProperties=species:S:1:pos:R:3\n"
        + "".join(f"C {row}\n" for row in rows),
        "headed.asc": f"//X Y Z R G B I\n{len(rows)}\n"
        + "".join(f"{row} 1 2 3 .5\n" for row in rows),
        "normals.txt": "".join(f"{row} 0 0.6 -0.8\n" for row in rows),
        "german.csv": "Klasse;X [mm];Y [mm];Z [mm]\n"
        + "".join(f"\uff1da;{row.replace(' ', ';').replace('.', ',')}\n" for row in rows),
        "text.csv": "".join(f"{row.replace(' ', ',')},a\u2028b\n" for row in rows),
        "colours.pts": "".join(f"{row} -7 1 2 3\n" for row in rows),
    }
    for name, text in more.items():
        (folder / name).write_text(text, encoding="utf-8")
    ascii_ply = "ply\nformat ascii 1.0\n" + f"element vertex {len(points)}\n"
    ascii_ply += (
        "property float x\nproperty float y\nproperty float z\n"
        + f"element face {len(mesh.faces)}\n"
    )
    ascii_ply += "property list uchar int vertex_indices\nend_header\n" + "\n".join(rows) + "\n"
    (folder / "ascii.ply").write_text(
        ascii_ply + "\n".join(f"3 {a} {b} {c}" for a, b, c in mesh.faces) + "\n"
    )
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in points[mesh.faces]
    )
    (folder / "ascii.stl").write_text(f"solid a\n{facets}endsolid a\n")
    (folder / "points.pts").write_text(
        f"{len(rows)}\n" + "\n".join(f"{row} -7 1 2 3" for row in rows)
    )
    for name, content in (
        _mixed_ply(mesh) | _gltf(mesh) | _vtk(mesh) | _vtp(mesh) | _pcd(points)
    ).items():
        (folder / name).write_bytes(content)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def _mixed_ply(mesh):
    """Return PLY files with texture coordinates of corners, polygons of several sizes, and strips."""
    head = (
        f"ply\nformat binary_%s_endian 1.0\nelement vertex {len(mesh.vertices)}\nproperty float x\n"
    )
    head += "property float y\nproperty float z\nelement {}\nproperty list uchar int vertex_indices\n{}end_header\n"
    polygons = [
        (*face, face[0]) if at % 3 == 0 else face for at, face in enumerate(mesh.faces.tolist())
    ]
    corners = [3, *[0.5] * 3]
    faces = b"".join(struct.pack(f">B{len(p)}iB3f", len(p), *p, *corners) for p in polygons)
    strips = b"".join(struct.pack("<B8i", 8, *face, -1, *face, -1) for face in mesh.faces.tolist())
    texture = "property list uchar float texcoord\n"
    return {
        "mixed.ply": (head % "big").format(f"face {len(polygons)}", texture).encode()
        + mesh.vertices.astype(">f4").tobytes()
        + faces,
        "strips.ply": (head % "little").format(f"tristrips {len(mesh.faces)}", "").encode()
        + mesh.vertices.astype("<f4").tobytes()
        + strips,
    }


def _gltf(mesh):
    """Return a glTF file that holds its data, and a GLB file of integers, with a strip and a sparse accessor."""
    plain = gltf.Scene()
    plain.node(mesh=plain.mesh(plain.plain(mesh.vertices, mesh.faces)), rotation=gltf.QUARTER)
    uri = "data:;base64," + base64.b64encode(plain.data).decode()
    document = plain.document | {"buffers": [{"byteLength": len(plain.data), "uri": uri}]}
    packed = gltf.Scene()
    size = np.abs(mesh.vertices).max()
    stored = np.round(mesh.vertices / size * 32767).astype("i2")
    positions = packed.accessor(stored, stride=8, normalized=True)
    packed.document["accessors"][positions]["sparse"] = {
        "count": 2,
        "indices": {
            "bufferView": packed.view(np.array([3, 5], dtype="<u2")),
            "componentType": 5123,
        },
        "values": {"bufferView": packed.view(stored[:2])},
    }
    indices = packed.accessor(mesh.faces.astype("<u2").ravel())
    primitive = {"attributes": {"POSITION": positions}, "indices": indices}
    inner = packed.node(
        root=False, mesh=packed.mesh(primitive, primitive | {"mode": 5}), scale=[size] * 3
    )
    packed.node(children=[inner], translation=[1, 2, 3])
    return {"mesh.gltf": json.dumps(document).encode(), "packed.glb": packed.glb()}


def _vtk(mesh):
    """Return legacy VTK files of both versions and encodings."""
    files, lists = {}, mesh.faces.tolist()
    for binary, version in ((False, 3), (True, 3), (False, 5), (True, 5)):
        blocks = [
            vtk.cells("POLYGONS", lists, binary, version),
            vtk.cells("TRIANGLE_STRIPS", lists, binary, version),
        ]
        content = vtk.vtk(blocks, binary=binary, version=version, points=mesh.vertices)
        files[f"mesh{version}-{binary}.vtk"] = content
    return files


def _vtp(mesh):
    """Return VTP files of every encoding, plain and compressed."""
    files = {}
    for mode in ("ascii", "binary", "base64", "raw"):
        for compressor in vtp.PACKERS:
            writer = vtp.Writer(mode, compressor)
            piece = writer.piece(mesh.vertices, mesh.faces.tolist())
            files[f"{mode}{compressor}.vtp"] = writer.file(piece)
    return files


def _pcd(points):
    """Return PCD files of the three encodings."""
    single, num = points.astype("<f4"), len(points)
    columns = pcd.literal_lzf(single.T.tobytes())
    return {
        "text.pcd": pcd.header(num) + pcd.text(single),
        "binary.pcd": pcd.header(num, data="binary") + single.tobytes(),
        "packed.pcd": pcd.header(num, data="binary_compressed")
        + struct.pack("<II", len(columns), single.nbytes)
        + columns,
    }


def landmark_files():
    """Return landmark files of every readable format by name, as the tests of their readers have them."""
    texts = {
        "several.tps": several.TPS,
        "several.nts": several.NTS,
        "several.txt": several.MORPHOLOGIKA,
        "slicer.mrk.json": one.slicer(one.TIP, one.BASE),
        "slicer.fcsv": one.FCSV,
        "table.csv": "label;x;y;z\ntip;0,5;0;0\nbase;1;2;3\n",
        "editor.pts": "Version 1.0\n2\nS000 0 0 0\nS001 1 2 3\n",
        "counted.csv": "1,0.5,0,0\n2,1,2,3\n3,4,5,7\n",
        "export.csv": "label,r,a,s,defined\n\uff1dtip,0.5,0,0,1\nba\u2028se,1,2,3,0\n",
        "wide.csv": "specimen,tip_x,tip_y,tip_z,X2,Y2,Z2\na,0.5,0,0,1,2,3\nb,1,2,3,4,5,7\n",
        "text.txt": "# label x y z\ntip 0,5 0 0\nbase 1 2 3\n",
        "scene.mrk.json": json.dumps(
            {
                "markups": [
                    {"type": kind, "coordinateSystem": "LPS", "controlPoints": [one.TIP, one.BASE]}
                    for kind in ("Plane", "Fiducial", "Curve")
                ]
            }
        ),
        "picked.pp": one.PICKED,
        "amira.landmarkAscii": one.AMIRA,
    }
    return {name: text.encode() for name, text in texts.items()}


def records():
    """Return the record of a shape and of a pair."""
    samples = _samples()
    return {"shape.record": encode(to_record(samples[0])), "pair.record": encode(_pair(samples))}


def _pair(samples):
    return to_record(match_pair(samples[0], samples[1], "SO", MatchOptions()))


def _samples():
    options = SamplingOptions(num_points=8, num_dense_points=9)
    return [
        sample_shape(crown(np.random.default_rng(i), num_vertices=80), options) for i in range(2)
    ]


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
