"""``collalign match``: two shapes, the best pose and its alternatives."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import scipy
from cyclopts import Parameter

from collalign.console.help import Flag
from collalign.console.messages import add_to_summary, say, say_files
from collalign.engine.progress import ProgressBar
from collalign.nonrigid.map_options import NonrigidOptions, SurfaceOptions
from collalign.nonrigid.spectral_shape import prepare_surface
from collalign.options import TwoShapeOptions
from collalign.output.vertex_maps import at_vertices
from collalign.output.views import write_picture
from collalign.products.shapes import free_rotation
from collalign.products.trust import DOUBT
from collalign.template_landmarks.on_surface import place_templates
from collalign.template_landmarks.templates import read_templates, shape_of
from collalign.tools.match.nonrigid import NonrigidMatch, match_prepared
from collalign.tools.match.pictures import match_picture, transferred_colours, vertices_map
from collalign.wording import note_records, note_text
from data_tools.arrays import FloatArray
from data_tools.errors import InputError, OptionsError
from data_tools.io.files import readable_stem
from data_tools.io.output_folder import OutputFolder, refuse_overlap
from data_tools.io.shapes import read_alike, read_shape, write_ply
from data_tools.landmark_files import Landmarks
from data_tools.notes import Note, percent
from data_tools.options import CleaningOptions
from data_tools.poses import scales_of
from data_tools.rotations import rotation_angle_deg
from data_tools.surface.shape import Shape
from pairwise.results import Status

if TYPE_CHECKING:
    from collalign.tools.match.in_part import PartialMatch
    from collalign.tools.match.rigid import RigidMatch

LANDMARKS_FILE = "map_landmarks.csv"
NONRIGID_FILES = (
    "map.npz", "map.txt", "map_back.txt", "map.png", "map_target.ply", "map_source.ply", LANDMARKS_FILE,
)  # fmt: skip


def stage_match(
    output: OutputFolder,
    found: NonrigidMatch,
    left: Shape,
    right: Shape,
    placed: Mapping[str, Landmarks],
) -> None:
    """Stage all files of a match.

    Parameters
    ----------
    output : OutputFolder
    found : NonrigidMatch
    left, right : Shape
        The target and the source, as stored.
    placed : mapping of str to Landmarks
        Those of either, see :func:`placed_landmarks`.
    """
    found.stage(output)
    point_map = vertices_map(found.point_map_target_source, left, right)
    confidence = at_vertices(np.append(found.vertex_confidence, np.nan), right)
    picture = match_picture(left, right, point_map, confidence, title=found.summary)
    write_picture(output.stage("map.png"), picture)
    of_target, of_source = transferred_colours(left, point_map)
    _write_coloured(output.stage("map_target.ply"), left, of_target)
    _write_coloured(output.stage("map_source.ply"), right, of_source, confidence=confidence)
    if placed:
        output.stage_table(carried_rows(found, (left, right), placed), LANDMARKS_FILE)


def placed_landmarks(
    files: Mapping[str, Path],
    shapes: Sequence[Shape],
    landmarks: Sequence[Path],
    cleaning: CleaningOptions,
) -> tuple[dict[str, Landmarks], tuple[Note, ...]]:
    """Return the landmarks that some files hold of two shapes, by shape and in its coordinates, and notes on them.

    Raises
    ------
    InputError
        If a file belongs to neither shape, or its landmarks do not lie on that.
    """
    given = read_templates(landmarks, [shape.name for shape in shapes])
    meshes = [(shape.name, shape.vertices, shape.faces) for shape in shapes]
    placed, notes, _ = place_templates(
        given, {name: files[name] for name in given}, meshes, cleaning
    )
    return placed, notes


def carried_rows(
    found: NonrigidMatch, shapes: tuple[Shape, Shape], placed: Mapping[str, Landmarks]
) -> list[list[str]]:
    """Return where landmarks of either shape are on the other one: a header, and a row for each.

    A landmark goes with the vertex that is nearest to it; its confidence is that of the vertex of the source, and it
    has no place where that has no counterpart.
    """
    rows = [["name", "landmark", "x", "y", "z", "confidence"]]
    for name, marks in placed.items():
        is_target = name == shapes[0].name
        on, other = shapes if is_target else shapes[::-1]
        to_source = vertices_map(found.point_map_source_target, shapes[1], shapes[0])
        to_target = vertices_map(found.point_map_target_source, *shapes)
        confidence = at_vertices(np.append(found.vertex_confidence, np.nan), shapes[1])
        for label, point in zip(marks.labels, marks.points, strict=True):
            own = int(((on.vertices - point) ** 2).sum(axis=1).argmin())
            image = int((to_source if is_target else to_target)[own])
            trust = confidence[image if is_target else own]
            known = image >= 0 and bool(np.isfinite(point).all())
            place = [*other.vertices[image], trust] if known else [np.nan] * 4
            rows.append(
                [other.name, label, *("" if np.isnan(value) else f"{value:.6g}" for value in place)]
            )
    return rows


def _write_coloured(path: Path, shape: Shape, colours: FloatArray, **values: FloatArray) -> Path:
    """Write a PLY with colours, and with values as further properties of the vertices."""
    channels = zip(
        ("red", "green", "blue"), np.round(255 * colours).astype(np.uint8).T, strict=True
    )
    return write_ply(path, shape.vertices, shape.faces, **dict(channels), **values)


#: Rescaling by less is not said. Copies of five generated surfaces in other triangles were rescaled by up to 1.6 %.
SAME_SIZE_TOL = 0.001
#: The command whose files these are, in the manifest of an output folder.
WRITER = "match"


@dataclass(frozen=True, kw_only=True)
class Bending:
    """How shapes are matched that bend.

    Parameters
    ----------
    nonrigid : bool
        Match deformable shapes; the options of deformation and surface belong to this.
    landmarks : tuple of Path
        Landmark files of either shape, called like it, that --nonrigid carries to the other (map_landmarks.csv).
    """

    nonrigid: Flag = False
    landmarks: Annotated[tuple[Path, ...], Parameter(negative=())] = ()
    deformation: NonrigidOptions = field(default_factory=NonrigidOptions)
    surface: SurfaceOptions = field(default_factory=SurfaceOptions)


def match(
    target: Path,
    source: Path,
    *,
    out: Path | None = None,
    partial: Flag = False,
    options: Annotated[TwoShapeOptions, Parameter(name="*")] = TwoShapeOptions(),  # noqa: B008
    bending: Annotated[Bending, Parameter(name="*")] = Bending(),
) -> int:
    """Match two shapes: the best pose and its alternatives, or (--nonrigid) a map of all vertices.

    Poses are ranked by the energies of the samples and by what neighbourhoods say, and every pose is refined on dense
    samples (--sampling.num-dense-points). With --no-refine the energies alone rank them.

    Parameters
    ----------
    target, source
        Two mesh or point cloud files; the result takes the source to the target.
    out
        Folder for the result: match.json and match.png, or the map both ways with its picture and coloured surfaces.
        In match.json the first "transform" is the answer, those of the candidates are about the samples alone. Maps
        go to the folder ``map`` by default, in the place of those that an earlier run wrote there.
    partial
        Match the surfaces by what they share, at the sizes of the files, and print the overlap of both. If no such
        pose is convincing, rotations, shifts and sizes are searched (not with --sampling.normalisation none).
    """
    out = out or (Path("map") if bending.nonrigid else None)
    if out is not None:
        refuse_overlap(out, (target, source, *(shape_of(path)[1] for path in bending.landmarks)))
        if bending.nonrigid:
            asked = replace(options, cleaning=replace(options.cleaning, columns=""))
            if partial or asked != TwoShapeOptions():
                raise OptionsError(
                    "--nonrigid goes with --deformation and --surface, not with options of poses"
                )
            return _match_nonrigid(target, source, out, bending, options.cleaning.as_stored)
    if bending != Bending():
        raise OptionsError(
            "--deformation, --surface and --landmarks go with --nonrigid (by poses: `transfer`)"
        )
    if partial:
        if options.certify or options.preset != "default":
            raise OptionsError(
                "--partial works on surfaces: --certify and --preset are for samples"
            )
        return _match_partial(target, source, out, options)
    from collalign.tools.match.rigid import match_rigid, with_mirror_score

    found = match_rigid(target, source, options=options)
    if options.group == "SO":
        found = with_mirror_score(found, options)
    add_to_summary(**found.record())
    say(_summary(found))
    _say_rescaled(found, found.source.name)
    if found.mirror_fits_better:
        note = Note("mirror-fits-better", (found.source.name,), {"energy": found.mirror_score})
        say(f"Note: {note_text(note)}")
    if out is not None:
        _write_rigid(found, target, source, out, options.cleaning)
    return 0


def _summary(found: RigidMatch) -> str:
    """Return five lines: the pose, what stands against it, and the transform."""
    poses, scores = found.result.candidates, found.scores
    words = f"{found.source.name} -> {found.target.name}: energy {scores[0]:.4g}"
    words += ", reflected" if poses[0].reflected else ""
    words += ", proven to be the best pose" if found.result.status is Status.PROVEN_OPTIMAL else ""
    if len(poses) > 1:
        first, other = (pose.R_target_source[:3, :3] for pose in poses[:2])
        apart = (
            "reflected"
            if poses[0].reflected != poses[1].reflected
            else f"{rotation_angle_deg(first.T @ other):.0f} deg away"
        )
        words += f"; the next best of {len(poses)} poses: {scores[1]:.4g}, {apart}"
    return "\n".join(
        [words, *("".join(f"{value:14.6g}" for value in row) for row in found.transform)]
    )


def _match_partial(target: Path, source: Path, out: Path | None, options: TwoShapeOptions) -> int:
    """Print and write the pose of two surfaces that overlap in part."""
    from collalign.tools.match.in_part import match_in_part, with_mirror_chance

    found = match_in_part(target, source, options=options)
    if options.group == "SO":
        found = with_mirror_chance(found, options)
    best = found.poses[0]
    doubt = " (in doubt)" if found.confidence < DOUBT else ""
    words = f"{found.source} -> {found.target}: confidence {percent(found.confidence)}{doubt}; "
    words += (
        f"{percent(best.overlap_source)} of it lies on {percent(best.overlap_target)} of the other"
    )
    rows = ("".join(f"{value:14.6g}" for value in row) for row in found.transform)
    add_to_summary(**found.record())
    say("\n".join([words, *rows]))
    _say_rescaled(found, found.source)
    if found.free_axis is not None:
        say(f"Note: {note_text(free_rotation(found.source, found.target, found.free_axis))}")
    if found.mirror_fits_better:
        note = Note("mirror-part-fits-better", (found.source,), {"chance": found.mirror_chance})
        say(f"Note: {note_text(note)}")
    if out is not None:
        _write_rigid(found, target, source, out, options.cleaning)
    return 0


def _say_rescaled(found: RigidMatch | PartialMatch, name: str) -> None:
    """Say by how much the transform makes the source larger or smaller, if it does."""
    scale = float(scales_of(found.transform))
    if abs(scale - 1.0) > SAME_SIZE_TOL:
        say(f"Note: {note_text(Note('rescaled', (name,), {'scale': scale}))}")


def _write_rigid(
    found: RigidMatch | PartialMatch,
    target: Path,
    source: Path,
    out: Path,
    cleaning: CleaningOptions,
) -> None:
    """Write the record and a picture of both shapes in one pose, equal colours where they lie on each other."""
    with OutputFolder.open(out, writer=WRITER) as output:
        output.stage_text(json.dumps(found.record(), indent=1), "match.json")
        left, right = read_alike((target, source), cleaning)
        nearest = scipy.spatial.cKDTree(left.vertices).query(
            right.transformed(found.transform).vertices
        )[1]
        write_picture(output.stage("match.png"), match_picture(left, right, nearest))
        say_files(output.publish())


def _match_nonrigid(
    target: Path, source: Path, out: Path, bending: Bending, cleaning: CleaningOptions
) -> int:
    """Write the map of all vertices and its picture; say what is known about it."""
    if bending.landmarks and readable_stem(target) == readable_stem(source):
        raise InputError(
            f"both shapes are called {readable_stem(target)}: landmarks do not say which they are of; rename one"
        )
    with (
        OutputFolder.open(out, writer=f"{WRITER} --nonrigid") as output,
        ProgressBar("steps", 4) as bar,
    ):
        output.refuse_foreign(NONRIGID_FILES)
        left, right = (
            read_shape(file, cleaning, name=readable_stem(file)) for file in (target, source)
        )
        shapes = left, right
        files = {shape.name: file for shape, file in zip(shapes, (target, source), strict=True)}
        placed, notes = placed_landmarks(files, shapes, bending.landmarks, cleaning)
        to = prepare_surface(shapes[0], bending.surface)
        bar.advance()
        of = prepare_surface(shapes[1], bending.surface)
        bar.advance()
        result = match_prepared(to, of, bending.deformation)
        bar.advance()
        stage_match(output, result, *shapes, placed)
        written = output.publish(complete=True)
        bar.advance()
    say(result.summary)
    for note in (*result.notes, *notes):
        say(f"Note: {note_text(note)}")
    add_to_summary(
        confidence=result.confidence,
        orientation=result.orientation,
        notes=note_records((*result.notes, *notes)),
    )
    say_files(written)
    return 0
