"""The text of every note: what happened, what it means, and what to do.

Stages and readers make notes as codes with fields (:class:`data_tools.notes.Note`). Here, and nowhere else, they
become sentences. A text without a condition is a template of its fields; ``{shapes}`` lists the names.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

from data_tools.notes import MAX_NAMED, Note, Value, listed, percent

_Text: TypeAlias = str | Callable[[Any], str]

#: What reading, cleaning and sampling did to one shape. These are phrases; a note of a part names it in front.
SHAPE_TEXTS: dict[str, _Text] = {
    "bytes-ignored": "ignored {num} bytes after the last triangle",
    "coarse-steps": "coordinates come in steps of {step:.3g}, {share:.1%} of its size: finer detail was lost",
    "components-kept": lambda of: _components_kept(**of.values),
    "count-off": "its first line promises {said} points, but {found} follow, and all were read",
    "decimated": "computed on a copy with {after} of {before} triangles",
    "degenerate-dropped": "dropped {num} triangles without area",
    "duplicates-merged": "merged {num} duplicate vertices",
    "edge-geodesics": "geodesic distances follow edges, because the heat method does not suit this mesh",
    "far-points-left-out": "left out {num} {points} far from all others, up to {times:.3g} times as far from the "
    "middle",
    "inner-walls": "{share:.0%} of the area is of walls inside",
    "inner-walls-dropped": "walls inside, {share:.0%} of the area, were left out",
    "made-of-parts": "made of {parts}",
    "no-endsolid": "the file has no 'endsolid': it may be cut off",
    "non-finite-dropped": "dropped {vertices} vertices that are NaN or infinite, with {triangles} triangles",
    "not-kept": "the file also has {things}, which are not kept",
    "outside-component": "{num} of {total} vertices are outside the largest component and are not matched",
    "plain-pieces": "the object is not the largest piece: larger ones, {share:.0%} of the area, are flat or boxes",
    "points-without-coordinates": "left out {num} of {total} points without coordinates",
    "shared-piece": "the object is the piece that the other files have; {share:.0%} of the area was left out",
    "stray-points-left-out": "left out {num} stray points off the surface",
    "subsampled": "computed on {kept} of {total} points",
    "tufted-laplacian": "computed with a tufted Laplacian, because of needles or edges of more than two triangles",
    "unreferenced-dropped": "dropped {num} vertices of no triangle",
}

#: What a user must know of a collection before trusting it.
COLLECTION_TEXTS: dict[str, _Text] = {
    "added-not-reflected": "The added shapes look like mirror images. The collection was aligned without "
    "reflections, which is kept. To reflect them, align all shapes again.",
    "all-incomplete": lambda of: (
        "Each shape shares only a part with the others, like scans from several sides. They are aligned on the "
        f"regions that they share: {_covered(of)}."
    ),
    "coarse-coordinates": lambda of: (
        f"Coordinates come in coarse steps: {_each(of, 'steps', '{:.3g}')}. Single "
        "precision has few digits far from the origin: detail was lost, and poses may be wrong. Shift the originals "
        "close to the origin, or save them in double precision or as text with all digits."
    ),
    "content-not-kept": "{num_shapes} of {total} files also have {things}, which aligned and exported meshes lack. "
    "To keep them, apply the transform in alignment.json to the original file.",
    "contradicted-by-hand": "{shapes}: POSE SET BY HAND, BUT MOST PAIRS CONTRADICT IT. Look at it again.",
    "contradicted-kept": "{shapes}: POSE KEPT FROM THE EARLIER RESULT, BUT MOST PAIRS CONTRADICT IT. Look at it "
    "again.",
    "copies": lambda of: _copies(of, **of.values),
    "components-joined": "Matched by all components, which tell poses apart better than the largest ones: {shapes}. "
    "To forbid this, use --cleaning.components largest.",
    "components-left-out": "In doubt, and matched without their smaller components: {shapes}. If these belong to the "
    "shapes, try --cleaning.components all.",
    "doubtful": "In doubt: {shapes}. The report shows them and their alternative poses.",
    "extra-material": lambda of: _extra(of),
    "few-for-sides": lambda of: (
        "So few shapes do not tell left from right surely: confidences are at most "
        f"{percent(of.values['most'])}. Check one shape of each side."
    ),
    "few-points": lambda of: (
        f"Fewer points than the {of.values['num']} that shapes are matched at: "
        f"{_each(of, 'counts', '{} points')}. Some of these count several times."
    ),
    "fewer-points": "Shapes are matched at {num} points: none has the {asked} asked for.",
    "given": lambda of: _given(**of.values),
    "incomplete": lambda of: (
        "Incomplete, and aligned on the regions shared with complete shapes: "
        f"{_covered(of)}. The mean is that of the complete shapes. Missing points have no label."
    ),
    "left-right-mixed": "The folder contains left and right specimens; {num_shapes} of {total} are of the rarer "
    "side: {shapes}. One side is reflected to match the other. To forbid this, use --group SO.",
    "most-pairs-disagree": "Most pairs contradict the common poses: the shapes may be too different to be aligned. "
    "Try more points (--sampling.num-points 128), or leave out shapes of another kind.",
    "much-larger": lambda of: (
        f"Much larger than the median shape: {_sized(of)}. The files may be in another unit."
    ),
    "much-smaller": lambda of: (
        f"Much smaller than the median shape: {_sized(of)}. The files may be in another unit."
    ),
    "kind-alone": lambda of: (
        f"The only {'one of its' if len(of.shapes) == 1 else 'ones of their'} kind: {listed(of.shapes)}. "
        f"{'It is' if len(of.shapes) == 1 else 'Each is'} kept as in the file, because there is nothing to align "
        f"{'it' if len(of.shapes) == 1 else 'them'} with."
    ),
    "kind-of": lambda of: _of_kind(of, **of.values),
    "kinds-found": lambda of: (
        f"The folder holds {of.values['num']} kinds of shapes, and each is aligned by itself: "
        f"{'; '.join(of.values['groups'])}. This split is {percent(of.values['confidence'])} sure. To align all "
        "together, use --clusters 1; to say how many kinds there are, --clusters K; to say which, --kinds-by."
    ),
    "kinds-given": lambda of: (
        f"Each of {of.values['num']} kinds is aligned by itself: {'; '.join(of.values['groups'])}."
    ),
    "kinds-apart": lambda of: (
        f"Not aligned with the kind of the reference, because pairs do not agree on a common frame: "
        f"{', '.join(of.values['kinds'])}. Compare poses within each of these kinds only."
        + (
            f" Nobody knows which way is {' and which is '.join(of.values['named'])} for them."
            if of.values["named"]
            else ""
        )
    ),
    "kinds-posed": lambda of: (
        "Rotated to the kind of the reference as most pairs of similar shapes ask for: "
        + ", ".join(
            f"{kind} ({percent(share)} of pairs agree)"
            for kind, share in zip(of.values["kinds"], of.values["shares"], strict=True)
        )
        + ". That is less sure than poses within a kind. Look at one shape of each."
    ),
    "no-confidence": "No confidence is known for any pose: the synchronization {method} does not estimate it.",
    "no-vertex-maps": "There are no maps of vertices: fewer than two meshes could be mapped to each other.",
    "not-reflected": "No mix of left and right specimens was found, so no shapes were reflected. In {num_better} of "
    "{num_pairs} similar pairs the mirror image fitted better.",
    "not-reflected-few": "No shapes were reflected: {num} shapes are too few to notice left and right specimens. If "
    "both are present, use --group O.",
    "not-reflected-posture": "No shapes were reflected. The mirror image fitted better in {num_better} of "
    "{num_pairs} similar pairs, but the surfaces are not mirror images in detail. This looks like posture.",
    "not-reflected-unclear": lambda of: _unclear(of, **of.values),
    "open-borders": lambda of: (
        f"{listed(of.shapes)}: in doubt, and the surface has open borders. If a part is "
        f"missing, use --incomplete {','.join(of.shapes)} to align what is preserved."
    ),
    "pairs-proven": lambda of: _pairs_proven(**of.values),
    "proofs-contradict": "Proven: the good poses of {pairs} are all more than {apart_deg:.0f} deg from the common "
    "poses. Any pose nearer to these costs more than {within:g} times the best.",
    "reflected-as-before": "Shapes may be reflected, as in the collection that they were added to.",
    "reflected-by-given-pose": "Shapes may be reflected, because a given pose reflects its shape.",
    "resembles-none": lambda of: _resembles_none(of, **of.values),
    "size-apart": lambda of: (
        f"Of another size than the others: {_sized(of)}. If they are not young or of another kind, check unit and "
        "voxel size, and whether a diameter was taken for a radius."
    ),
    "several-kinds": "The pairs agree within {num} groups of shapes, but not between them: {groups}. If these are "
    "kinds of their own, use --clusters {num} or --kinds-by to align each by itself.",
    "shared-pieces": lambda of: (
        "Taken as the object, as the other files show it, beside pieces as large or larger: "
        f"{_with(of, map(percent, of.values['shares']))} of the area left out. To match these too, use "
        "--cleaning.components all."
    ),
    "shown-in-part": "The page shows {num} of {total} shapes: the {num_doubtful} most doubtful, and some of the "
    "others. alignment.json, pairs.csv and the exports hold all.",
    "sides-by-fit": "In {num_between} pairs between the sides the mirror image fits better, by a median factor of "
    "{factor:.2f} in energy. The surfaces agree. {contradicted:.1%} of the evidence contradicts the sides.",
    "sides-by-surface": "The surfaces of the two sides are mirror images of each other in detail, whatever the "
    "poses.",
    "sides-in-one-place": lambda of: (
        "One place of each surface tells its side; the rest hardly differs from its mirror image. An injury looks "
        f"like this too, so confidences are at most {percent(of.values['most'])}. "
        "If no specimen should be reflected, use --group SO."
    ),
    "sides-not-confirmed": lambda of: _not_confirmed(of, **of.values),
    "sides-sampled": "Left and right specimens were looked for among {num} of {total} shapes.",
    "symmetric": lambda of: _symmetric(**of.values),
    "unconnected": "No pairs connect {num} parts of the collection. Poses can be compared within each part only.",
    "unjoined-scans": "No overlap joins all shapes. Poses can be compared within these groups only: {groups}.",
    "walls-left-out": lambda of: (
        "Walls inside were left out, which cannot be seen from outside and which other shapes do not have: "
        f"{_with(of, map(percent, of.values['shares']))} of the surface. To keep them, use --cleaning.inner keep."
    ),
    "vertex-maps-doubtful": lambda of: (
        "The maps of these shapes are more likely wrong than right: "
        f"{_with(of, map(percent, of.values['confidences']))}. The report shows where."
    ),
    "vertex-maps-missing": "{shapes}: no map of the vertices ({reason}).",
}

#: What commands add about tables, landmarks, statistics, exports and proofs.
TOOL_TEXTS: dict[str, _Text] = {
    "arrangement-bound": "Proven: no consistent arrangement of these {num} shapes is more than {gap:.2%} cheaper "
    "than the result, or {unproven:.2%} cheaper than the cheapest one known. Lower bound {bound:.6g}, result "
    "{result:.6g}, cheapest {cheapest:.6g}. These are squared distances of {num_points} matched samples, summed over "
    "{num_pairs} pairs. The search stopped because {ended}.",
    "arrangement-cheapest": "The poses of the result are those of the cheapest arrangement known, up to {deg:.0f} "
    "deg.",
    "arrangement-fixed": "What is unproven is {times:.2g} times what the pairs of one shape cost on average. Single "
    "shapes were not tested.",
    "arrangement-free": "Every single shape may still be free: more is unproven than the pairs of one shape cost "
    "({one:.2%} on average).",
    "arrangement-refuted": lambda of: _refuted(of, **of.values),
    "arrangement-scope": "Not proven: that the poses are anatomically right, or that the cheapest poses are.",
    "asymmetry-uncertain": "The directional asymmetry ({directional:.2g} radii) is not larger than the error of "
    "finding the other side ({error:.2g} radii). All specimens share this error. Do not report the asymmetry unless "
    "landmarks show it too.",
    "blocks-carried": "The mean surface carries the landmarks of the blocks to all shapes, because some have none of "
    "their own.",
    "blocks-compared": "Integration of {first} and {second}: r-PLS {r:.3f}, Z {z:.2f}, P {p:.3g}.",
    "coordinates-aligned": "Coordinates: the common frame with sizes made alike. {num_reflected} of {total} "
    "specimens are reflected. Tables of specimens have centroid sizes. For coordinates of the files, use "
    "--space raw.",
    "coordinates-procrustes": "Coordinates: superimposed at unit centroid size. {num_reflected} of {total} specimens "
    "are reflected. The table of specimens has the centroid sizes.",
    "coordinates-raw": "Coordinates: those of the files.",
    "coordinates-raw-sides": "Coordinates: those of the files. {num_reflected} of {total} specimens are of the other "
    "side and are not reflected, which statistics would find as shape. For statistics, do not use --space raw.",
    "coordinates-unscaled": "Coordinates: the common frame, in the unit of each file. {num_reflected} of {total} "
    "specimens are reflected; centroid sizes are kept. For the coordinates of the files, use --space raw.",
    "directions-itk": "Each .tfm takes points of the common frame to the file's own, the direction in which images "
    "are resampled. Its inverse takes points of the file to the common frame. 3D Slicer applies the inverse to a "
    "mesh. In SimpleITK, GetInverse() gives it.",
    "directions-shapeworks": "alignment_1 takes points of the file to the common frame. Its inverse takes them back.",
    "directions-tables": "T11 to T34 of the table of shapes are rows of a matrix. It takes points of the file to the "
    "common frame, and its inverse takes them back.",
    "groups-of-one": lambda of: (
        f"{of.values['column']}: groups of one specimen are not tested: {_with(of, of.values['groups'])}. Correct "
        "the names of their groups, or leave them out."
    ),
    "labels-missing": "{source}: there is no row for {shapes}.",
    "labels-misspelt": lambda of: (
        f"{of.values['column']}: "
        f"{_with(of, (f'{a!r}, elsewhere {b!r}' for a, b in _both(of, 'groups', 'similar')))}. "
        "If these are typing errors, correct them: they count as groups of their own."
    ),
    "labels-not-numbers": lambda of: (
        f"{of.values['column']}: {_with(of, (f'{cell!r} is not a number' for cell in _tuple(of, 'cells')))}. "
        "Correct these cells before statistics."
    ),
    "labels-of-copies": lambda of: (
        f"{listed(of.shapes)} are one surface, but differ in {of.values['column']}: {_joined(of.values['labels'])}. "
        "A file or a label is wrong."
    ),
    "labels-of-sides": lambda of: _sides(of, **of.values),
    "labels-of-sides-unseen": "{column}: {num_left} of {total} shapes are labelled left, the others right, but no "
    "shape was reflected. If they were not mirrored before, sides were not told apart: align with --group O.",
    "labels-of-size": lambda of: (
        f"The size does not fit {of.values['column']}. It is {_sized(of)} of what the label lets expect. Check the "
        "label, and the unit or voxel size of the file."
    ),
    "labels-of-strangers": "{shapes} resembles no other shape, though others share its labels: {labels}. Check "
    "whether it is what its labels say.",
    "labels-taken-as": lambda of: (
        f"{of.values['source']}: rows are matched to shapes whose names nearly agree: "
        f"{_with(of, (f'row {row}' for row in _tuple(of, 'rows')))}. Check them."
    ),
    "labels-unknown": lambda of: (
        f"{of.values['source']}: no shape is called "
        f"{_paired_if(_tuple(of, 'rows'), _tuple(of, 'hints'))}. These rows are not used."
    ),
    "landmark-codes": "{shapes}: landmarks taken as missing: {labels}. Their three coordinates are one number, off "
    "the surface.",
    "landmarks-beside": "Landmarks beside the shapes are not aligned: {files}. To carry them to all shapes, use "
    "`collalign transfer OUT --landmarks FILE`.",
    "landmarks-close": "{shapes}: its landmarks are close together, and {times:.4g} times as large they lie on the "
    "surface. Check their unit.",
    "landmarks-converted": "{shapes}: landmarks converted from {declared} to {system}, the system of the surface.",
    "landmarks-in-system": "{shapes}: landmarks and surface are both in {system}, so landmarks are taken as they "
    "are.",
    "landmarks-off-surface": lambda of: (
        f"{listed(of.shapes)}: landmarks off its surface keep their distance: "
        f"{_paired(of.values['labels'], (f'{one:.4g}' for one in of.values['distances']))}."
    ),
    "landmarks-renamed": "{shapes}: its landmarks have other names than those of {template}; {how}.",
    "landmarks-renumbered": "{shapes}: {labels} was taken as {taken_as}, which other templates have at that place. "
    "If these are two landmarks, give them names that are not numbers.",
    "landmarks-respelt": "{shapes}: {labels} was taken as {taken_as}. Case, blanks, separators and leading zeros "
    "are ignored in the names of landmarks.",
    "landmarks-too-far": "{shapes}: landmarks taken as missing: {labels}. They are farther from the surface than its "
    "radius.",
    "left-out-differ": lambda of: _left_out_differ(**of.values),
    "left-out-doubtful": lambda of: (
        f"{_counted(len(of.shapes), 'shape is', 'shapes are')} left out only for a doubtful pose. With "
        f"--include-doubtful {of.values['num']} shapes count instead of {of.values['counted']}. Their poses are "
        f"right with a chance of {percent(of.values['chance'])} on average. "
        "A wrong pose counts as a difference of shape. Confirm or correct these poses in the report first."
    ),
    "groups-left-out": lambda of: (
        f"The shapes that count are not like all shapes in {of.values['column']}: "
        + ", ".join(
            f"of {kind} {num} of {total}"
            for kind, (num, total) in zip(
                _tuple(of, "groups"), _both(of, "counted", "totals"), strict=True
            )
        )
        + ". Results hold for what counts."
    ),
    "left-out-of-statistics": lambda of: (
        f"Left out of the statistics: {_with(of, map(reason_text, of.values['reasons']))}."
    ),
    "map-half-turned": "The map may be half turned: the other way round, with {exchanged} exchanged, it fits nearly "
    "as well. Compare the picture with the second candidate, or align both shapes in a folder with others "
    "(--deformable).",
    "no-counterpart": "{other} is cut: {share:.0%} of the vertices of {shapes} have no counterpart on it. The map "
    "has -1 there.",
    "measured-again": "The repeatability of shape is {repeatability:.3f}, from {measurements} measurements of {num} "
    "specimens (Rsq {r2:.3f}).",
    "free-rotation": "{shapes} may be turned as you like about an axis along {axis}, in coordinates of {whole}: "
    "it lies on {whole} all the way round.",
    "mirror-fits-better": "The mirror image of {shapes} fits much better, with an energy of {energy:.4g}. If one "
    "shape is of the other side, or was reflected, use --group O.",
    "mirror-part-fits-better": lambda of: (
        f"The mirror image of {listed(of.shapes)} fits much better: its poses have a chance of "
        f"{percent(of.values['chance'])}. If one shape is of the other side, or was reflected, use --group O."
    ),
    "model-leaves-out": "The model {model} leaves out {num_shapes} shapes without a value, or alone in their group: "
    "{shapes}.",
    "no-landmarks": "{shapes}: left out markups whose points are no landmarks: {kinds}.",
    "not-shapes": lambda of: (
        f"Skipped {_counted(of.values['num'], 'file that is not a shape', 'files that are not shapes')}: "
        f"{_joined(of.values['files'])}."
    ),
    "plain-left-out": lambda of: (
        "Taken as the object beside larger pieces that are flat or boxes, such as a table: "
        f"{_with(of, map(percent, of.values['shares']))} of the area left out. To match these too, use "
        "--cleaning.components all."
    ),
    "not-slid": "Semilandmarks of these specimens were not slid, because some of their landmarks are missing: "
    "{shapes}.",
    "posture-taken-out": "Posture is taken out: each part ({parts}) is at its mean place among the others.",
    "selected": "The selection keeps {kept} of {total} shapes, stated at {least:.3f} or more; {share:.1%} of these "
    "poses are expected to be right.",
    "selected-none": "The selection keeps none of {total} shapes: none is stated so surely. Ask for a smaller share.",
    "sides-compared": "{num} individuals have both sides, {first} and {second}. {individuals:.1%} of the variation "
    "of shape is among individuals, {directional:.1%} between sides (directional asymmetry, p = {p:.3g}). "
    "{fluctuating:.1%} is how individuals differ in their sides (fluctuating asymmetry).",
    "sides-lacking": "One side is lacking of {individuals}. These do not count where sides are compared.",
    "sides-exchanged": "{shapes}: {labels} lie on the other side than the other pairs of left and right landmarks. "
    "Check whether left and right are exchanged.",
    "sides-reordered": "{shapes}: mirrored, the landmarks of one side lie in another order than those of the other "
    "side. Check whether some are exchanged: {labels}.",
    "size-not-tested": lambda of: (
        "Size is not tested, because some files are probably in another unit: "
        f"{_each(of, 'times', '{:.3g} times the median')}. Convert them, or leave them out."
    ),
    "rescaled": "{shapes} was rescaled by a factor of {scale:.4g}: two shapes are matched up to size. If sizes "
    "matter, as on worn or broken surfaces, use --partial, which keeps them.",
    "tables-beside": "Tables beside meshes are not aligned: {files}. To align them too, name them, or use "
    "--include.",
    "templates-doubtful": lambda of: (
        f"{listed(of.shapes)}: the pose of this template is in doubt. Its landmarks were "
        f"{'carried all the same, and may lie' if of.values['counted'] else 'not carried, since they might lie'} at "
        "wrong places. Look at it in the report, confirm or correct its pose, and carry them again."
    ),
    "templates-disagree": lambda of: _templates_disagree(of, **of.values),
    "templates-reordered": lambda of: _templates_reordered(of, **of.values),
}
_TEXTS = {**SHAPE_TEXTS, **COLLECTION_TEXTS, **TOOL_TEXTS}

_COPIES = {
    "identical": "these files are identical",
    "moved": "these files hold one surface in different poses or sizes",
    "mirrored": "these files hold mirror images of one surface",
}
#: Why shapes are incomplete, do not count or have no map, how labels were matched, and why a search stopped.
_REASONS = {
    "named": "you named it",
    "found-before": "found by an earlier run",
    "cut-off": "similar shapes go on beyond its rim",
    "likelier-as-part": "its pose is surer as that of a part of the others",
    "scan": "it shares only a part with the others",
    "stranger": "it resembles no other shape",
    "no-relative": "it resembles no other shape",
    "contradicted": "points and neighbourhoods would rather have another pose",
    "block": "it may be rotated together with some others",
    "misfit": "it fits the others badly",
    "few-shapes": "few shapes and no neighbourhood tell its poses apart",
    "symmetry": "other poses look the same",
    "side": "its side is in doubt",
    "one-view": "it shows one side only, which need not be that of the others",
    "partners": "it is no surer than the shapes that it lies on",
    "overlap-alone": "nothing but overlap joins it to the others",
    "other-reading": "as a part of the others it would lie elsewhere than as a whole shape",
    "doubtful": "in doubt",
    "incomplete": "incomplete",
    "alone": "the only one of its kind",
    "other-part": "not aligned with the largest part",
    "excluded": "excluded by name",
    "less-sure": "less sure than the share of right poses asks for",
    "not-registered": "the mean surface could not be laid onto it",
    "no-trusted-pair": "no trusted pair connects it to the others",
    "by-order": "they were matched by their order",
    "curves-by-order": "curves were matched by their order",
    "without-prefix": "they were matched by what follows their prefix",
    "enough": "enough is proven",
    "too-many": "the shapes are too many for multipliers, so the bounds of all pairs are added",
    "no-gain": "the bound no longer rises",
    "rounds": "the rounds ended",
    "time": "there was no time for another round",
}
#: What leads to factors between sizes, and how near to one a factor counts as it.
_FACTORS = {
    2.0: "a diameter for a radius, or twice the voxel size?",
    2.54: "inches for centimetres?",
    10.0: "millimetres for centimetres?",
    25.4: "millimetres for inches?",
    100.0: "centimetres for metres?",
    1000.0: "millimetres for metres?",
}
_NEAR = 1.1
_UNCLEAR = {
    "no-outer-side": "Without triangles that agree on an outer side, side and posture cannot be told apart.",
    "few-shapes": "So few shapes do not tell side and posture apart.",
    "surfaces": "The surfaces alone do not tell the sides clearly: it may be posture.",
}


def note_text(note: Note) -> str:
    """Return a note in words; its code and fields where this version knows no text for them.

    Parameters
    ----------
    note : Note

    Examples
    --------
    >>> texts = [collalign.note_text(note) for note in collalign.load("aligned").notes]
    >>> collalign.note_text(collalign.results.Note("doubtful", ("a", "b")))
    'In doubt: a, b. The report shows them and their alternative poses.'
    """
    text = _TEXTS.get(note.code, "")
    fields = {name: _joined(value) for name, value in note.values.items()}
    fields |= {"shapes": listed(note.shapes), "num_shapes": len(note.shapes)}
    fields |= {
        name: reason_text(str(fields[name]))
        for name in ("reason", "how", "ended")
        if name in fields
    }
    try:
        said = text.format_map(fields) if isinstance(text, str) else text(note)
    except (KeyError, TypeError, ValueError):  # of another version, or damaged
        said = ""
    if note.code in SHAPE_TEXTS and note.shapes:
        said = f"{listed(note.shapes)}: {said}"
    return said or str(note)


def reason_text(code: str) -> str:
    """Return the words of a reason; those of an error, or of another version, are their own text."""
    return _REASONS.get(code, code)


def note_records(notes: Iterable[Note]) -> list[dict[str, Any]]:
    """Return notes in JSON types: ``code``, ``shapes``, ``values`` and ``text``."""
    return [{**note.record(), "text": note_text(note)} for note in notes]


def _joined(value: Value) -> str | int | float:
    return listed([*map(str, value)]) if isinstance(value, tuple) else value


def _counted(num: int, one: str, several: str) -> str:
    return f"{num} {one if num == 1 else several}"


def _paired(names: Iterable[str], words: Iterable[str]) -> str:
    return listed([f"{name} ({word})" for name, word in zip(names, words, strict=True)])


def _paired_if(names: Iterable[str], words: Iterable[str]) -> str:
    """Return names, those with a word on them with the word."""
    both = zip(names, words, strict=True)
    return listed([f"{name} ({word})" if word else name for name, word in both])


def _with(note: Note, words: Iterable[str]) -> str:
    """Return the shapes of a note with a word on each."""
    return _paired(note.shapes, words)


def _each(note: Note, field: str, pattern: str) -> str:
    """Return the shapes of a note with a number of each."""
    return _with(note, map(pattern.format, _tuple(note, field)))


def _sized(note: Note) -> str:
    """Return the shapes of a note with the factors of their sizes."""
    return _with(note, map(_times, _tuple(note, "times")))


def _times(times: float) -> str:
    """Return a factor between sizes, and what usually leads to it."""
    factor = max(times, 1.0 / times)
    usual = (words for of, words in _FACTORS.items() if of / _NEAR <= factor <= of * _NEAR)
    return ": ".join([f"{times:.3g} times", *list(usual)[:1]])


def _both(note: Note, one: str, other: str) -> list[tuple[Any, Any]]:
    """Return two fields that hold one value per shape, side by side."""
    return [*zip(_tuple(note, one), _tuple(note, other), strict=True)]


def _tuple(note: Note, field: str) -> tuple[Any, ...]:
    """Return a field that holds one value per shape."""
    value = note.values[field]
    if not isinstance(value, tuple):
        raise TypeError(field)
    return value


def _components_kept(
    kept: int, total: int, share: float, dropped: int, chosen: bool = False
) -> str:
    which = "the largest" if kept == 1 else f"the {kept} largest, which are nearly of one size,"
    which = "this" if chosen else which
    lost = f", dropped {dropped} triangles" if dropped else ""
    return f"kept {which} of {total} components ({share:.3g} % of the area){lost}"


def _covered(note: Note) -> str:
    shares, reasons = _tuple(note, "coverages"), _tuple(note, "reasons")
    words = [
        f"covers {percent(share)}" if share else "covers nothing, perhaps an intruder"
        for share in shares
    ]
    if len({*reasons}) == 1 < len(reasons):  # said of all at once
        each = "; ".join(f"{name} ({word})" for name, word in zip(note.shapes, words, strict=True))
        return each if reasons[0] == "scan" else f"{each}: of each, {reason_text(reasons[0])}"
    return "; ".join(
        f"{name} ({reason_text(why)}; {word})"
        for name, why, word in zip(note.shapes, reasons, words, strict=True)
    )


def _extra(note: Note) -> str:
    found = zip(note.shapes, _tuple(note, "shares"), _tuple(note, "sides"), strict=True)
    each = "; ".join(
        f"{name} ({percent(share)} of its surface, towards {side} of the common frame)"
        for name, share, side in found
    )
    left_out = (
        "and correspondences leave it out."
        if note.values["ignored"]
        else "but correspondences do not. To leave it out of these and of statistics, use --ignore-extra."
    )
    return f"Extra material, such as a stand, that no other shape has: {each}. Poses ignore it, {left_out}"


def _copies(note: Note, kind: str) -> str:
    others = note.shapes[1:]
    named = f"add --exclude {' '.join(map(shlex.quote, others))}"
    return (
        f"{listed(note.shapes)}: {_COPIES[kind]}. Each counts as a specimen in means and statistics. To count "
        f"one, {named if len(others) <= MAX_NAMED else 'leave the others out (--exclude)'}."
    )


def _given(
    *,
    num_invariants: int = 0,
    weight: float = 1.0,
    num_samples: int = 0,
    num_posed: int = 0,
    num_near: int = 0,
    near_deg: float = 0.0,
    num_weights: int = 0,
    num_zero: int = 0,
    num_ordered: int = 0,
) -> str:
    words = []
    if num_invariants:
        words.append(f"invariants ({num_invariants} columns of weight {weight:g})")
    if num_samples:
        words.append(f"samples ({num_samples} a shape)")
    if num_posed:
        words.append(
            f"poses of {num_posed} pairs, {num_near} within {near_deg:g} deg of the result"
        )
    if num_weights:
        words.append(f"weights of {num_weights} pairs, {num_zero} left out")
    if num_ordered:
        words.append(f"the order of {num_ordered} scans")
    return f"Given by you: {'; '.join(words)}."


def _pairs_proven(
    num_optimal: int,
    num_tried: int,
    num_wanted: int,
    num_chirality: int,
    num_improved: int,
    num_complete: int,
    within: float,
    num_unique: int,
) -> str:
    words = [f"{num_optimal} of {num_tried} pairs are proven optimal."]
    if num_tried < num_wanted:
        words.append(f"{num_wanted} were worth proving, but the budget ended.")
    if num_chirality:
        words.append(f"{num_chirality} decisions on reflections are proven.")
    if num_improved:
        words.append(f"{num_improved} better poses were found.")
    words.append(
        f"Of {num_complete} pairs all poses within {percent(within - 1)} of the best energy are known."
    )
    return f"{' '.join(words)} {num_unique} of these have no second pose."


def _left_out_differ(
    column: str,
    num: int,
    total: int,
    range: tuple[float, float],
    range_counted: tuple[float, float],
    p: float,
) -> str:
    return (
        f"The {num} shapes that count are not like all {total} in {column}: it is {range_counted[0]:.4g} to "
        f"{range_counted[1]:.4g} among them, and {range[0]:.4g} to {range[1]:.4g} in all (P = {p:.2g} for left out "
        "against counted). Results hold for that range only."
    )


def _sides(note: Note, column: str, labels: tuple[str, ...], num_agree: int, total: int) -> str:
    each = _with(note, (f"{label!r}" for label in labels))
    return (
        f"{column}: labels and surfaces contradict each other for {each}. {num_agree} of {total} labels agree with "
        "the sides that were found. Correct the labels, or look at these poses."
    )


def _refuted(note: Note, saving: float, doubtful: tuple[str, ...]) -> str:
    said = "Other evidence supports the poses of the result, and none of these is in doubt."
    if doubtful:
        said = f"The result itself doubts {listed(doubtful)}: see R_cheapest_shape in certification.json."
    return f"Refuted: rotating {listed(note.shapes)} costs {saving:.2%} less. {said}"


def _resembles_none(note: Note, mismatch: float, median: float) -> str:
    verb, pronoun = ("resembles", "it") if len(note.shapes) == 1 else ("resemble", "them")
    return (
        f"{listed(note.shapes)} {verb} no other shape. Consider leaving {pronoun} out. The mismatch with the most "
        f"similar shape is {mismatch:.2f}; that of the median shape is {median:.2f}, and 1 is chance."
    )


def _templates_disagree(note: Note, labels: tuple[str, ...], distances: tuple[float, ...]) -> str:
    named = _paired(labels, (f"{one:.3g}" for one in distances))
    if len(note.shapes) == 1:
        return (
            f"{note.shapes[0]} has landmarks far from where the other templates have them, and does not count there: "
            f"{named}. Look at agreement.png."
        )
    which = " and ".join(note.shapes)
    return (
        f"Templates {which} disagree on {named}. One of them may be wrong. Look at agreement.png."
    )


_REORDERED = {
    "swapped": "swapped?",
    "reversed": "is the whole order reversed?",
    "shifted": "are the names shifted?",
    "exchanged": "are the names exchanged?",
    "renamed": "one landmark under two names?",
}


def _of_kind(note: Note, of_kind: str, of_code: str, **values: Value) -> str:
    return f"Of {of_kind}: {note_text(Note(of_code, note.shapes, values))}"


def _templates_reordered(
    note: Note, kind: str, labels: tuple[str, ...], places: tuple[str, ...]
) -> str:
    of, other = note.shapes[0], [*note.shapes[1:], "the others"][0]
    wrong = f"in {of}" if len(note.shapes) == 1 else f"in {of} or {other}"
    named = listed(labels) if len(labels) != 2 else " and ".join(labels)
    said = f"Templates disagree on {named} {wrong}: {_REORDERED[kind]}"
    said += (
        f" There {of} has {labels[0]} at the place of {places[0]} of {other}."
        if kind != "swapped"
        else ""
    )
    if kind == "renamed":
        return f"{said} If so, give it one name in all files."
    done = (
        f"{of} does not count there."
        if len(note.shapes) == 1
        else "No other specimen gets these landmarks."
    )
    return f"{said} {done} Correct the file, and run the command again."


def _symmetric(num: int, total: int, rotations: str, up_to: float, absolute: float) -> str:
    return (
        f"{num} of {total} shapes have a symmetry: they fit as well in other poses. Their poses are defined only up "
        f"to these rotations of the common frame: {rotations}. The median confidence is {percent(up_to)} up to "
        f"these, and {percent(absolute)} without them."
    )


def _not_confirmed(note: Note, num_better: int, num_pairs: int, most: float) -> str:
    at_most = f" So confidences are at most {percent(most)}." if most < 1.0 else ""
    return (
        f"The surfaces of {listed(note.shapes)} look like mirror images of the others, but no shape was reflected: "
        f"the mirror image fits better in {num_better} of {num_pairs} pairs.{at_most} To forbid reflections, use "
        "--group SO."
    )


def _unclear(note: Note, num_better: int, num_pairs: int, cause: str) -> str:
    return (
        f"No shapes were reflected, but {listed(note.shapes)} may be mirror images of the others: in {num_better} of "
        f"{num_pairs} similar pairs the mirror image fitted better. {_UNCLEAR[cause]} If left and right specimens "
        "are mixed, use --group O; if not, --group SO."
    )
