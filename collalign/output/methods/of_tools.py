"""What a methods section says of the tools that read an alignment, by the options of their records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from collalign.output.methods.references import (
    ARTICULATED,
    DRAKE,
    GOODALL,
    GUNZ,
    LUETHI,
    MATCHING_SYMMETRY,
    OBJECT_SYMMETRY,
    PEREZ,
    REPEATABILITY,
    RRPP,
    TWO_BLOCKS,
)
from collalign.products.trust import DOUBT
from data_tools.notes import listed, percent

#: A sentence, with the references that it needs.
Sentence: TypeAlias = tuple[str, tuple[str, ...]]


def counted(num: int, one: str, several: str) -> str:
    """Return a number with its noun."""
    return f"{num} {one if num == 1 else several}"


def specimens(names: Sequence[str]) -> str:
    """Return how many specimens these are, and their names."""
    return f"{counted(len(names), 'specimen', 'specimens')} ({listed(names)})"


def _transfer(options: Mapping[str, Any]) -> Iterator[Sentence]:
    templates, num = options["templates"], options["num_landmarks"]
    kind = "template" if len(templates) == 1 else "templates"
    yield (
        f"{num} landmarks were carried to all specimens from {len(templates)} {kind} ({', '.join(templates)}), whose "
        "landmarks had been placed by hand. A mean surface was registered to every specimen by a smooth deformation "
        "(Lüthi et al. 2018), and each landmark was fitted by the surface around it.",
        (LUETHI,),
    )
    if len(templates) > 2:
        yield (
            "Predictions of several templates were averaged. A template that the others contradicted at a landmark "
            f"did not count there ({counted(options['num_contradicted'], 'case', 'cases')}).",
            (),
        )
    if options["semilandmarks"]:
        counts = Counter(one["kind"] for one in options["semilandmarks"])
        points = sum(one["num"] for one in options["semilandmarks"])
        kinds = [counted(count, one, _PLURALS[one]) for one, count in counts.items()]
        yield f"{points} of them are semilandmarks on {listed(kinds)}.", ()
    if options["slide"] is not None:
        to, source = {
            "bending": ("the bending energy", GUNZ),
            "procrustes": ("the Procrustes distance", PEREZ),
        }[options["slide"]]
        yield f"Semilandmarks were slid to where {to} from the mean is least.", (source,)
    yield f"{options['num_carried']} landmarks were carried.", ()
    if lacking := options["num_lacking"]:
        placed = counted(lacking, "landmark", "landmarks")
        yield (
            f"The program did not place {placed}, where a pose was in doubt or the surface had no such place.",
            (),
        )
    if options["left_out_error"] is not None:
        yield (
            "Predicting each template from the others gave a mean error of "
            f"{options['left_out_error']:.3g} (median {options['left_out_median']:.3g}), in the unit of the files.",
            (),
        )
    if options["median_radius"] is not None:
        yield (
            f"The estimated radius that holds nine of ten errors has a median of {options['median_radius']:.3g}.",
            (),
        )


_PLURALS = {"curve": "curves", "closed curve": "closed curves", "patch": "patches"}


def _variation(options: Mapping[str, Any]) -> Iterator[Sentence]:
    yield (
        f"{options['num_shapes']} surfaces were brought into dense correspondence ({options['num_vertices']} "
        "vertices) by registering their mean to each (Lüthi et al. 2018), and superimposed at unit centroid size.",
        (LUETHI,),
    )
    yield from _members(options["left_out"], include_doubtful=options["include_doubtful"])
    if options["without_posture"]:
        yield (
            "Each part of a specimen was brought to its mean place first (Adams 1999).",
            (ARTICULATED,),
        )
    tests = options["tests"]
    kind = "sequential" if tests["sums_of_squares"] == "I" else "marginal"
    how = f"{tests['permutations']} random permutations (seed {tests['seed']})"
    columns = [column for column in options["labels"] if column]
    against = listed(["centroid size", *columns])
    yield (
        f"Shape was tested against {against} by Procrustes ANOVA (Goodall 1991) with {kind} sums of squares "
        f"(type {tests['sums_of_squares']}) and permuted residuals (Collyer and Adams 2018); allometric scores are "
        f"those of Drake and Klingenberg (2008). All tests used {how}.",
        (GOODALL, RRPP, DRAKE),
    )
    if tests["model"]:
        yield f"The model shape ~ {tests['model']} was tested.", ()
    if options["symmetry"] is not None:
        yield (
            "Symmetric and asymmetric components within each specimen were separated, and directional and "
            "fluctuating asymmetry tested (Klingenberg et al. 2002).",
            (OBJECT_SYMMETRY,),
        )
    if options["sides"] is not None:
        yield (
            "Left and right of each individual were compared by a Procrustes ANOVA of individuals, sides and their "
            "interaction (Klingenberg and McIntyre 1998).",
            (MATCHING_SYMMETRY,),
        )
    if options["repeats"] or (options["individuals"] is not None and options["sides"] is None):
        again = (
            "landmarks that were placed again" if options["repeats"] else "repeated measurements"
        )
        yield (
            f"The error of measurement was estimated from {again}, as repeatability (Lessells and Boag 1987; "
            "Fruciano 2016).",
            REPEATABILITY,
        )
    if tests["blocks"]:
        yield (
            f"Integration of blocks of landmarks ({'; '.join(tests['blocks'])}) was tested by two-block partial "
            "least squares (Rohlf and Corti 2000; Adams and Collyer 2016).",
            TWO_BLOCKS,
        )


def _members(left_out: Iterable[Sequence[str]], *, include_doubtful: bool) -> Iterator[Sentence]:
    """Say who did not count, and who decided that."""
    of_reason: dict[str, list[str]] = {}
    for name, reason in left_out:
        of_reason.setdefault(reason, []).append(name)
    if own := of_reason.pop("excluded", None):
        yield f"We left out {specimens(own)}.", ()
    words = {
        "doubtful": f"poses of a confidence below {percent(DOUBT)}",
        "incomplete": "incomplete surfaces",
        "other-part": "specimens that it could not align with the others",
        "not-registered": "specimens onto which it could not lay the mean surface",
    }
    parts = [f"{words.get(why, why)} ({listed(names)})" for why, names in of_reason.items()]
    if parts:
        yield f"The program left out {'; '.join(parts)}.", ()
    if include_doubtful:
        yield f"By our choice, poses of a confidence below {percent(DOUBT)} counted as well.", ()


def _export(options: Mapping[str, Any]) -> Iterator[Sentence]:
    if own := options["exclude"]:
        yield f"We left out {specimens(own)} of what was exported.", ()
    if options["right"] is not None:
        yield (
            f"Only the surest poses were exported, of which the program expects {options['right']:.1%} or more to be "
            "right.",
            (),
        )
    yield f"Coordinates were exported as {_SPACES[options['space']]}.", ()


_SPACES = {
    "aligned": "aligned, in the common frame",
    "unscaled": "aligned, in the units of the files",
    "raw": "in the files",
    "procrustes": "superimposed by generalised Procrustes analysis",
}
#: What a methods section says of a tool by the options of its record.
TOOLS: dict[str, Callable[[Mapping[str, Any]], Iterator[Sentence]]] = {
    "transfer": _transfer,
    "variation": _variation,
    "export": _export,
}
