"""``collalign match``: two shapes, the best pose and its alternatives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from collalign.nonrigid import NonrigidOptions, SurfaceOptions, match_shapes
from collalign.nonrigid.page import vertices_map, write_match_page
from collalign.nonrigid.pictures import draw_match
from collalign.nonrigid.result import NonrigidMatch
from collalign.options import TwoShapeOptions
from collalign.stages.pairs.match import pair_problem
from collalign.stages.poses.refinement import dense_points
from collalign.stages.shapes import sample_file, shape_task
from data_tools.arrays import FloatArray
from data_tools.embedding.embedding import Samples
from data_tools.io.files import write_atomic
from data_tools.io.output_folder import OutputFolder
from data_tools.io.shapes import read_shape
from data_tools.options import CleaningOptions
from data_tools.percent import percent
from pairwise.dense.refine import RefinedPose
from pairwise.match import match_problem
from pairwise.options import DenseOptions
from pairwise.results import Candidate, MatchResult

#: The command whose files these are, in the manifest of an output folder.
WRITER = "match"
NONRIGID_FILES = ("map.npz", "map.txt", "map.png", "map.html")


def match(
    target: Path,
    source: Path,
    *,
    out: Path | None = None,
    nonrigid: Annotated[bool, Parameter(negative=())] = False,
    num_matches: int | None = None,
    unmatched_penalty: float | None = None,
    options: Annotated[TwoShapeOptions, Parameter(name="*")] = TwoShapeOptions(),  # noqa: B008
    dense: DenseOptions = DenseOptions(),  # noqa: B008
    deformation: NonrigidOptions = NonrigidOptions(),  # noqa: B008
    surface: SurfaceOptions = SurfaceOptions(),  # noqa: B008
) -> int:
    """Match two shapes: the best pose and its alternatives, or (--nonrigid) a map of all vertices.

    Every pose is refined on dense samples (--sampling.num-dense-points) and the poses are ranked by the energies on
    both kinds of samples, unless --no-refine is given.

    Parameters
    ----------
    target, source
        Two mesh or point cloud files; the result takes the source to the target.
    out
        Folder for the result: match.json, or map.npz, map.txt, map.png and map.html. A pose is printed as well;
        its first "transform" is the answer, those of the candidates are about the samples alone.
    nonrigid
        Match deformable shapes; the options of deformation and surface belong to this.
    num_matches
        Partial shapes: match so many samples only, and leave the others out on both sides.
    unmatched_penalty
        Partial shapes: what leaving a sample out costs, in squares of the centroid size of the samples.
    """
    if nonrigid:
        return _match_nonrigid(target, source, out or Path("."), deformation, surface)
    samples = [sample_file(shape_task(file, file.stem, options)) for file in (target, source)]
    problem = pair_problem(
        samples[0], samples[1], options.group, num_matches=num_matches, unmatched_penalty=unmatched_penalty
    )
    clouds = None
    if options.refine and options.sampling.num_dense_points:
        clouds = dense_points(samples[0]), dense_points(samples[1])
    result = match_problem(problem, options.seeded(), dense=clouds, dense_options=dense)
    text = json.dumps(_record(target, source, samples, result), indent=1)
    print(text)
    if out is not None:
        with OutputFolder.open(out, writer=WRITER) as output:
            output.stage("match.json").write_text(text, encoding="utf-8")
            (path,) = output.publish()
        print(path)
    return 0


def _match_nonrigid(target: Path, source: Path, out: Path, options: NonrigidOptions, surface: SurfaceOptions) -> int:
    """Write the map of all vertices and its picture; say what is known about it."""
    with OutputFolder.open(out, writer=WRITER) as output:
        output.refuse_foreign(NONRIGID_FILES)
        result = match_shapes(target, source, options=options, surface_options=surface)
        write_atomic(output.stage("map.npz"), result.npz_bytes())
        write_atomic(output.stage("map.txt"), result.text_bytes())
        _draw_nonrigid(result, target, source, output)
        written = output.publish()
    best = result.candidates[0]
    print(
        f"{result.source_name} -> {result.target_name}: confidence {percent(result.confidence)}, {best.orientation}"
    )
    print(f"{result.bijectivity:.0%} of the samples come back near themselves; {len(result.candidates)} candidates")
    for note in result.notes:
        print(f"Note: {note}")
    for path in written:
        print(path)
    return 0


def _draw_nonrigid(result: NonrigidMatch, target: Path, source: Path, output: OutputFolder) -> None:
    """Stage the picture and the page of a map."""
    as_stored = CleaningOptions(merge_vertices=False, largest_component=False)
    left, right = (read_shape(file, as_stored) for file in (target, source))
    point_map = vertices_map(result.point_map_target_source, left, right)
    draw_match(output.stage("map.png"), left, right, point_map)
    write_match_page(output.stage("map.html"), result, left, right)


def _record(target: Path, source: Path, samples: list[Samples], result: MatchResult) -> dict[str, Any]:
    """Return the result with poses as 4 x 4 transforms from the source file's coordinates to the target file's."""
    to, of = samples
    return {
        "target": str(target),
        "source": str(source),
        "status": result.status.name,
        "advice": result.status.value,
        "energy": result.energy,
        "lower_bound": None if np.isnan(result.lower_bound) else result.lower_bound,
        "transform": _transform(to, of, result.refined or result.candidates[0]).tolist(),
        "candidates": [
            {
                "transform": _transform(to, of, candidate).tolist(),
                "energy": candidate.energy,
                "refined": None if candidate.refined is None else _refined(to, of, candidate.refined),
                "reflected": candidate.reflected,
                "map_target_source": [
                    int(to.vertex_indices[i]) if i >= 0 else -1 for i in candidate.map_target_source
                ],
            }
            for candidate in result.candidates
        ],
        "source_vertices": of.vertex_indices.tolist(),
    }


def _refined(to: Samples, of: Samples, pose: RefinedPose) -> dict[str, Any]:
    """Return what the dense samples say of a candidate: mean costs per point before and after refinement."""
    return {
        "transform": _transform(to, of, pose).tolist(),
        "initial_energy": pose.initial_energy,
        "energy": pose.energy,
        "iterations": pose.iterations,
        "status": pose.status.name,
    }


def _transform(to: Samples, of: Samples, pose: Candidate | RefinedPose) -> FloatArray:
    """Return x -> scale_to * (scale * R (x - offset_of) / scale_of + shift) + offset_to as a 4 x 4 matrix."""
    linear = pose.R_target_source[:3, :3] * (pose.scale * to.scale / of.scale)
    shift = np.zeros(3) if pose.translation is None else to.scale * pose.translation[:3]
    transform = np.eye(4)
    transform[:3, :3] = linear
    transform[:3, 3] = to.offset + shift - linear @ of.offset
    return transform
