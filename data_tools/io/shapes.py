"""Reading and writing shapes: one way for every format, one kind of error, arrays checked before anything else."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from data_tools.arrays import FloatArray, IntArray, extremes, read_only
from data_tools.errors import CollalignError, InputError, UnavailableError
from data_tools.io.files import readable_stem, write_atomic
from data_tools.io.formats.obj_off_stl import STL_TRIANGLE
from data_tools.io.formats.raw_shape import RawShape
from data_tools.io.listing import READERS, TABLES, joint_digest, parts_of
from data_tools.io.source import Origin, Source, read_source, read_start
from data_tools.notes import Note
from data_tools.options import CleaningOptions
from data_tools.surface.cleaning import clean, drop_non_finite, is_assembled
from data_tools.surface.hidden import as_seen
from data_tools.surface.outliers import without_outliers
from data_tools.surface.shape import Shape

#: The code of the note of a shape in coarse steps.
COARSE = "coarse-steps"


def fits_single(vertices: FloatArray) -> bool:
    """Return whether single precision moves no point (v, 3) by more than a millionth of the shape's size."""
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    if not len(finite):
        return True
    with np.errstate(over="ignore"):
        moved = np.abs(finite.astype(np.float32) - finite).max()
    low, high = extremes(finite)
    return bool(moved <= 1e-6 * (high - low).max())


def coarse_note(vertices: FloatArray) -> tuple[Note, ...]:
    """Return a note where coordinates are in single precision, in steps above a thousandth of the shape's size.

    Parameters
    ----------
    vertices : ndarray, shape (v, 3)
        Finite.

    Returns
    -------
    tuple of Note
        One with the step and its share of the size, or none.
    """
    low, high = extremes(vertices)
    coordinates = np.ascontiguousarray(vertices.T)
    with np.errstate(all="ignore"):  # of what is beyond single precision
        is_single = (coordinates.astype(np.float32) == coordinates).all(axis=1)
        steps = np.where(is_single, np.spacing(np.maximum(-low, high).astype(np.float32)), 0.0)
    step, size = float(steps.max()), float(np.linalg.norm(high - low))
    if not step > 1e-3 * size:
        return ()
    return (Note(COARSE, values={"step": step, "share": step / size}),)


def coarse_coordinates(notes: Mapping[str, Sequence[Note]]) -> tuple[Note, ...]:
    """Return the note that names the shapes of a collection in coarse steps; none if there are none.

    Parameters
    ----------
    notes : mapping of str to sequence of Note
        The notes of each shape by its name.
    """
    found = {
        name: one.values["step"] for name, own in notes.items() for one in own if one.code == COARSE
    }
    steps = tuple(float(step) for step in found.values() if not isinstance(step, tuple))
    return (Note("coarse-coordinates", tuple(found), {"steps": steps}),) if found else ()


#: Suffixes that :func:`write_mesh` knows.
WRITABLE = (".ply", ".off", ".obj", ".stl", ".glb")
#: Largest number of triangles around one vertex. Decimation takes its square: 4 s at this number.
MAX_TRIANGLES_OF_VERTEX = 10_000


def _called(suffix: str) -> tuple[str, str]:
    return suffix, f"its content is that of a {suffix} file; rename it"


#: How files begin, the suffix of which that is right, and what to do where they have another one.
_BEGINNINGS = {
    rb"\s*ply\s": _called(".ply"),
    rb"\s*solid\b": _called(".stl"),
    rb"\s*(?:ST)?C?N?OFF\s": _called(".off"),
    rb"\s*(?:(?:#|mtllib |[go] )[^\n]*\n\s*)*v[ \t]+[-+.\d]": _called(".obj"),
    rb"# vtk DataFile": _called(".vtk"),
    rb"# \.PCD": _called(".pcd"),
    rb"\s*(?:<\?xml.*\s+)?<VTKFile": _called(".vtp"),
    rb"glTF": _called(".glb"),
    rb"PK\x03\x04": (".npz", "it is a ZIP archive; unpack it"),
    rb"\x1f\x8b": ("", "it is compressed with gzip; unpack it"),
    rb"\s*<(?:!doctype )?html": ("", "it is a web page; download the file again"),
    rb"version https://git-lfs": (
        "",
        "it is a pointer of Git LFS; get the file with `git lfs pull`",
    ),
}


def read_shape(
    path: Origin | str,
    cleaning: CleaningOptions | None = None,
    *,
    name: str | None = None,
    digest: str | None = None,
) -> Shape:
    """Read and clean a mesh or point cloud; its suffix names the format.

    Meshes: PLY, STL, OBJ, OFF, GLB, GLTF, VTK (legacy) and VTP. Points: PCD, PTS, XYZ, ASC, TXT, CSV, and PLY, OBJ,
    VTK, VTP. Either: NPZ with ``vertices`` (or ``points``) and perhaps ``faces``. Polygons are split into triangles.

    Parameters
    ----------
    path : Path, str or Source
        ``A.*`` stands for a specimen of several parts (:func:`data_tools.io.listing.parts_of`), whose vertices count
        those of the cleaned parts, one part after the other.
    cleaning : CleaningOptions, optional
    name : str, optional
        The file's stem by default.
    digest : str, optional
        What :func:`data_tools.io.source.hash_source` said of the file when it was looked at first.

    Returns
    -------
    Shape
        ``notes`` says what reading and cleaning changed.

    Raises
    ------
    UnavailableError
        If the file is missing or cannot be read here and now, does not fit in memory, has changed or vanished since
        it was looked at first, or needs a package that is not installed.
    InputError
        Naming the file and the reason: empty, truncated, another content than its suffix says, values that
        are not finite, indices out of range, no points.
    """
    try:
        if parts := parts_of(path):
            return _of_parts(Path(str(path)), parts, cleaning, name=name, digest=digest)
        return shape_from_source(read_source(path), cleaning, name=name, digest=digest)
    except InputError:
        if digest is not None and not _is_there(path):
            raise UnavailableError(
                f"{path}: has vanished since the run began; put it back, or run again without it"
            ) from None
        raise
    except MemoryError as error:
        raise UnavailableError(
            f"{path.path if isinstance(path, Source) else path}: does not fit in memory"
        ) from error


def _is_there(path: Origin | str) -> bool:
    """Return whether there is a shape in memory, a file, or files of parts."""
    try:
        return isinstance(path, Source) or bool(parts_of(path)) or Path(path).exists()
    except InputError:
        return False


def read_alike(paths: Sequence[Origin], cleaning: CleaningOptions | None = None) -> list[Shape]:
    """Read shapes that are matched with each other; all components are kept of those that are assembled of several.

    Parameters
    ----------
    paths : sequence of Path or Source
    cleaning : CleaningOptions, optional

    Raises
    ------
    UnavailableError, InputError
        As :func:`read_shape`.
    """
    cleaning = CleaningOptions() if cleaning is None else cleaning
    shapes = [read_shape(path, cleaning) for path in paths]
    if cleaning.components != "auto":
        return shapes
    whole = replace(cleaning, components="all")
    return [
        read_shape(path, whole) if is_assembled(shape.notes) else shape
        for path, shape in zip(paths, shapes, strict=True)
    ]


def shape_from_source(
    source: Source,
    cleaning: CleaningOptions | None = None,
    *,
    name: str | None = None,
    digest: str | None = None,
) -> Shape:
    """Return the shape that a file holds; see :func:`read_shape`."""
    path = source.path
    reader = READERS.get(source.suffix)
    if reader is None:
        raise InputError(
            f"{path}: unknown suffix {path.suffix!r}; readable are {', '.join(sorted(READERS))}"
        )
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            table = TABLES.get(source.suffix)
            raw = table(source, cleaning.columns if cleaning else "") if table else reader(source)
    except InputError as error:
        raise InputError(f"{error}{_other_content(source)}") from None
    except (CollalignError, MemoryError):
        raise
    except ImportError as error:
        raise UnavailableError(
            f"{path}: cannot be read without the package {error.name}; install it"
        ) from error
    except (
        Exception
    ) as error:  # readers of damaged files fail in every way there is, and quote them
        kind = source.suffix[1:].upper()
        raise InputError(
            f"{path}: not a readable {kind} file, it is damaged or of another format{_other_content(source)}"
        ) from error
    if digest is not None and source.digest != digest:
        raise UnavailableError(f"{path}: has changed since the run began; run again")
    cleaning = CleaningOptions() if cleaning is None else cleaning
    shape = clean(_checked(source, raw, name or readable_stem(path)), cleaning)
    shape = shape if cleaning.components == "all" else without_outliers(shape, cleaning)
    return as_seen(shape, cleaning)


def _other_content(source: Source) -> str:
    """Say what a file is that cannot be read, where it begins like another kind of file than its suffix says."""
    start = source.content[:1000].removeprefix(b"\xef\xbb\xbf")
    for beginning, (suffix, advice) in _BEGINNINGS.items():
        if suffix != source.suffix and re.match(beginning, start, re.IGNORECASE):
            return f"; {advice}"
    return ""


def _of_parts(
    path: Path,
    parts: dict[str, Path],
    cleaning: CleaningOptions | None,
    *,
    name: str | None,
    digest: str | None,
) -> Shape:
    """Return the parts of a specimen, each cleaned by itself, as one shape."""
    sources = {part: read_source(file) for part, file in parts.items()}
    if (
        digest is not None
        and joint_digest([(part, one.digest) for part, one in sources.items()]) != digest
    ):
        raise UnavailableError(f"{path}: has changed since the run began; run again")
    shapes = [shape_from_source(source, cleaning, name=part) for part, source in sources.items()]
    return Shape.of_parts(name or readable_stem(path), shapes, file=path)


def write_mesh(path: Path | str, shape: Shape) -> Path:
    """Write a shape as PLY (binary), OFF, OBJ, STL or GLB, by the suffix, atomically.

    Text has every digit. Binary files are in single precision unless that would move points by a millionth of the
    shape's size, as in coordinates of a map: then PLY is in double precision, STL is text, and GLB has its offset in
    a node.

    Raises
    ------
    InputError
        If the suffix is none of these, or a point cloud is to be written to a format without clouds.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise InputError(f"{path}: cannot write {suffix!r}; writable are {', '.join(WRITABLE)}")
    if not shape.is_mesh and suffix not in (".ply", ".obj"):
        raise InputError(f"{path}: a point cloud can be written as .ply or .obj")
    if suffix == ".ply":
        return write_ply(path, shape.vertices, shape.faces)
    content = {".obj": _obj, ".off": _off, ".stl": _stl, ".glb": _glb}[suffix](
        shape.vertices, shape.faces
    )
    return write_atomic(path, content)


def _obj(vertices: FloatArray, faces: IntArray) -> bytes:
    return (_text_rows("v ", vertices) + _text_rows("f ", faces + 1)).encode()


def _off(vertices: FloatArray, faces: IntArray) -> bytes:
    head = f"OFF\n{len(vertices)} {len(faces)} 0\n"
    return (head + _text_rows("", vertices) + _text_rows("3 ", faces)).encode()


def _stl(vertices: FloatArray, faces: IntArray) -> bytes:
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    if fits_single(vertices):
        triangles = np.zeros(len(faces), dtype=STL_TRIANGLE)
        triangles["normal"], triangles["corners"] = normals, corners
        return b"collalign".ljust(80) + len(faces).to_bytes(4, "little") + triangles.tobytes()
    rows = zip(normals.tolist(), corners.tolist(), strict=True)
    facets = [
        f"facet normal {' '.join(map(repr, normal))}\nouter loop\n"
        + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for normal, triangle in rows
    ]
    return "".join(["solid collalign\n", *facets, "endsolid collalign\n"]).encode()


def _glb(vertices: FloatArray, faces: IntArray) -> bytes:
    import trimesh

    place = np.eye(4)
    if not fits_single(vertices):
        place[:3, 3] = vertices.mean(axis=0)
    scene = trimesh.Scene()
    scene.add_geometry(
        trimesh.Trimesh(vertices - place[:3, 3], faces, process=False), transform=place
    )
    content: bytes = scene.export(file_type="glb")
    return content


def _text_rows(start: str, rows: NDArray[Any]) -> str:
    """Return each row as a line of numbers in full."""
    return "".join(f"{start}{' '.join(map(repr, row))}\n" for row in rows.tolist())


def write_ply(path: Path, vertices: FloatArray, faces: IntArray, **values: NDArray[Any]) -> Path:
    """Write a shape as binary PLY, atomically, with values of the vertices, shape (v,), as further properties.

    Bytes, such as ``red``, stay; all else is in single precision, but for positions that would lose by it
    (:func:`write_mesh`). MeshLab, ParaView, 3D Slicer and R (Rvcg) read it.
    """
    columns = dict(zip("xyz", vertices.T, strict=True)) | values
    kinds = {
        name: ("uchar", "u1") if column.dtype == np.uint8 else ("float", "<f4")
        for name, column in columns.items()
    }
    if not fits_single(vertices):
        kinds |= dict.fromkeys("xyz", ("double", "<f8"))
    points = np.rec.fromarrays(
        list(columns.values()), dtype=[(name, code) for name, (_, code) in kinds.items()]
    )
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property {word} {name}" for name, (word, _) in kinds.items()]
    triangles = np.empty(len(faces), dtype=[("corners", "u1"), ("vertices", "<i4", 3)])
    triangles["corners"], triangles["vertices"] = 3, faces
    if len(faces):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return write_atomic(
        path, b"".join(["\n".join([*header, "end_header\n"]).encode(), points.data, triangles.data])
    )


def _checked(source: Source, raw: RawShape, name: str) -> Shape:
    path, faces, notes, kept = source.path, raw.faces, raw.notes, raw.places
    vertices = np.asarray(raw.vertices)
    if vertices.size == 0:
        raise InputError(f"{path}: holds no points")
    file_size = raw.file_size or len(vertices)
    try:
        if (
            np.size(faces)
            and vertices.dtype.kind == "f"
            and vertices.shape[1:] == (3,)
            and not np.isfinite(vertices).all()
        ):
            vertices, faces, kept, note = drop_non_finite(name, vertices, faces)
            notes = (*notes, note)
        shape = Shape.from_arrays(
            vertices, faces, name=name, file=path if source.is_file else None, notes=notes
        )
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{name}: ')}") from error
    low, high = extremes(shape.vertices)
    extent = float(np.maximum(-low, high).max())
    if extent > 1e100 or (low == high).all():
        reason = "coordinates beyond 1e100" if extent > 1e100 else "all points lie in one place"
        raise InputError(f"{path}: {reason}")
    shape = replace(shape, notes=(*shape.notes, *coarse_note(shape.vertices)))
    triangles_of = np.bincount(shape.faces.ravel(), minlength=1)
    if triangles_of.max() > MAX_TRIANGLES_OF_VERTEX:
        raise InputError(
            f"{path}: vertex {triangles_of.argmax()}, counted from 0, is a corner of {triangles_of.max()} triangles, "
            f"more than {MAX_TRIANGLES_OF_VERTEX}. Split faces of many corners otherwise than at one corner"
        )
    return (
        shape
        if kept is None
        else replace(shape, source_indices=read_only(kept), file_size=file_size)
    )


#: Where x and y grow: to the left and posterior, or to the right and anterior; z grows to superior in both.
CoordinateSystem = Literal["LPS", "RAS"]
#: Takes coordinates of either system to the other.
LPS_RAS = read_only(np.array([-1.0, -1.0, 1.0]))
_HEADER_BYTES = 1000


def declared_system(file: Origin) -> CoordinateSystem | None:
    """Return the system that a mesh file declares in its header as 3D Slicer does (``SPACE=RAS``).

    None where it, or the first of several parts, declares none, as most do, or is not there any more: 3D Slicer takes
    those as LPS.
    """
    try:
        first = next(iter(parts_of(file).values()), file)
        found = re.search(rb"SPACE=(LPS|RAS)\b", read_start(first, _HEADER_BYTES))
    except UnavailableError:
        return None
    return None if found is None else "LPS" if found[1] == b"LPS" else "RAS"
