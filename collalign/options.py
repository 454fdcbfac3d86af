"""Every option of an alignment, in one place: the command line and the TOML file are generated from these classes.

>>> from collalign.options import AlignOptions, SamplingOptions
>>> wanted = AlignOptions(seed=1, sampling=SamplingOptions(num_points=32))
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from typing import Any, ClassVar, Literal, TypeAlias, TypedDict

import numpy as np

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from data_tools.checks import check_count, check_kinds, check_number
from data_tools.errors import OptionsError
from data_tools.io.files import composed
from data_tools.options import (
    CleaningKeywords,
    CleaningOptions,
    EmbeddingKeywords,
    EmbeddingOptions,
    SamplingKeywords,
    SamplingOptions,
)
from pairwise.options import MatchOptions, PairKeywords, PairOptions

__all__ = [
    "AlignOptions",
    "CleaningOptions",
    "EmbeddingOptions",
    "PairOptions",
    "RunOptions",
    "SamplingOptions",
    "TwoShapeOptions",
]

#: Seeds are below this: stores and keys hold 64-bit numbers.
_SEED_LIMIT = int(np.iinfo(np.int64).max) + 1
#: Most rounds of what is repeated until nothing is new: pairs added, incomplete shapes looked for.
MAX_ROUNDS = 3
#: Seconds for the proof of a pair where nobody says how many.
PROOF_S = 30.0
#: Rotations only, mirror images as well, or whichever of the two the shapes ask for.
Group = Literal["SO", "O", "auto"]
#: Which pairs of shapes are matched.
PairStrategy = Literal["auto", "all", "sparse", "adaptive"]
#: How the pairs' rotations become one rotation per shape.
Synchronizer = Literal["robust", "spectral"]
#: Where the axes of the common frame come from.
Gauge = Literal["reference", "axes"]
#: Directions that ``up`` and ``front`` may have without landmarks.
FRAME_AXES: dict[str, tuple[float, float, float]] = {
    **{"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)},
    **{"-x": (-1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0), "-z": (0.0, 0.0, -1.0)},
}
#: The ``origin`` that is that of the reference's file.
FILE_ORIGIN = "file"
#: Three numbers: a direction or a point of the reference's file.
_THREE_NUMBERS = re.compile(r"[-+.\deE]+(,[-+.\deE]+){2}")
#: Whether non-rigid maps help to choose the poses.
Maps = Literal["auto", "always", "never"]
#: Values of ``AlignOptions.incomplete`` that name no shapes, and the one that means every shape.
AUTO, NEVER, ALL = "auto", "never", "all"
#: Whether the common frame keeps the sizes of the shapes.
Scaling = Literal["similarity", "rigid"]
#: Which pipeline the defaults of the other options are for.
Preset = Literal["default", "paper"]
#: What each preset sets. The paper's (Maron et al. 2016, section 6.3 and appendices A and B): 20 farthest points, xyz
#: and 4 LB coordinates with block-diagonal R, PM-SDP over conv SO(3) of all pairs, four starts, the eigenvectors.
PRESETS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {
        "group": "SO",
        "pairs": "all",
        "synchronization": "spectral",
        "maps": "never",
        "incomplete": NEVER,
        "refine": False,
        "clusters": 1,
        "sampling": {"num_points": 20, "num_dense_points": 0},
        "embedding": {"kind": "xyz+lb"},
        "matching": {"strategy": "relaxation", "row_sums": False, "num_draws": 0},
    },
}


@dataclass(frozen=True, kw_only=True)
class AlignOptions:
    """What decides the result of :func:`collalign.align_collection`.

    Parameters
    ----------
    preset : {"default", "paper"}
        default searches rotations of each pair and chooses among candidates; paper is the published pipeline (Maron
        et al. 2016): PM-SDP over conv SO(3) of all pairs at 20 points, positions and 4 Laplace-Beltrami coordinates,
        and the eigenvectors of appendix B, without confidence and refinement. An option that differs from its own
        default wins over the preset.
    group : {"SO", "O", "auto"}
        SO keeps every shape as it is; O may reflect shapes (left and right specimens in one folder); auto reflects
        only where pairs of similar shapes clearly say that both sides are there (a single pair of shapes is matched
        as with SO).
    scaling : {"similarity", "rigid"}
        similarity brings all shapes to one size; rigid keeps the sizes of the files.
    pairs : {"auto", "all", "sparse", "adaptive"}
        Which pairs are matched: all, a sparse connected graph, or a sparse one that grows where poses are uncertain;
        auto matches all pairs of up to 40 shapes and is adaptive beyond.
    synchronization : {"robust", "spectral"}
        robust chooses among the pairs' candidates, resists wrong pairs and refines; spectral is the paper's appendix
        B as published, with neither confidence nor refinement.
    maps : {"auto", "always", "never"}
        Whether non-rigid maps of each pair, started from many poses, propose and judge poses: for shapes that bend.
        auto asks them where the pairs match badly and contradict each other, and shapes are not assembled of
        components; they take about a tenth of a second a pair, and need meshes.
    incomplete : str
        Shapes of which parts are missing: their names, separated by commas; never, all (scans from several sides), or
        auto for those beyond whose rim the others go on. They are posed on the complete ones of their kind, or where
        there is none on each other, by what has a counterpart there. Scans are posed on one complete shape, their
        model, at the sizes of the files.
    ignore_extra : bool
        Leave material that no other shape has, such as a stand, plaster or a neighbouring bone, out of
        correspondences and statistics. Poses ignore it in any case, and a note says where it is.
    refine : bool
        Refine the poses on dense samples (``sampling.num_dense_points``) after synchronization.
    deformable : bool
        Map all vertices between all shapes, consistently around cycles (``collection.vertex_maps``): for meshes that
        bend. Takes some seconds a shape and half a second for each of about six pairs a shape.
    reference : str
        Name of the shape whose orientation is the common frame's; the first one if empty.
    gauge : {"reference", "axes"}
        Orientation of the common frame: the reference's, or the principal axes of all aligned shapes together. Poses
        set by hand go before both.
    up : str
        Which way of the reference is up: an axis of its file (z, -y), which then is that axis of the common frame;
        from one of its landmarks to another (base:vertex); or a direction in its file (0.1,0,0.9). Landmarks and
        numbers rotate the common frame, so that z is up and x to the front. Pages and pictures look at the front.
    front : str
        Which way its front is, in the same words.
    origin : str
        Where the common frame has its origin: at a landmark of the reference, at a point of its file (1,2,3), or at
        the origin of that (file); by default in the middle of each shape.
    clusters : int
        Kinds of shapes in a mixed folder, each of which is aligned by itself; 0 finds out whether there are several,
        1 aligns all shapes together.
    seed : int
        Seed of everything random; the same seed gives the same bytes.
    certify : bool
        Try to prove the best pose of pairs with competing poses, and of those that synchronization rejects.
    certify_budget_s : float
        Seconds for all proofs together, per worker; the least settled pairs come first.
    certify_pair_s : float
        Seconds for the proof of one pair.
    strict : bool
        Stop at the first file or pair that fails instead of leaving it out.
    cleaning : CleaningOptions
        How meshes are repaired.
    sampling : SamplingOptions
        Which points represent a shape.
    embedding : EmbeddingOptions
        Which coordinates the points carry.
    matching : PairOptions
        How a pair is matched.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    preset: Preset = "default"
    group: Group = "auto"
    scaling: Scaling = "similarity"
    pairs: PairStrategy = "auto"
    synchronization: Synchronizer = "robust"
    maps: Maps = "auto"
    incomplete: str = AUTO
    ignore_extra: bool = False
    refine: bool = True
    deformable: bool = False
    reference: str = ""
    gauge: Gauge = "reference"
    up: str = ""
    front: str = ""
    origin: str = ""
    clusters: int = 0
    seed: int = 0
    certify: bool = False
    certify_budget_s: float = 600.0
    certify_pair_s: float = PROOF_S
    strict: bool = False
    cleaning: CleaningOptions = field(default_factory=CleaningOptions)
    sampling: SamplingOptions = field(default_factory=SamplingOptions)
    embedding: EmbeddingOptions = field(default_factory=EmbeddingOptions)
    matching: PairOptions = field(default_factory=PairOptions)

    def __post_init__(self) -> None:
        check_kinds(self)
        _apply(PRESETS[self.preset], self)
        for name in ("certify_budget_s", "certify_pair_s"):
            check_number(name, getattr(self, name), positive=True)
        check_count("clusters", self.clusters, lower=0)
        check_count("seed", self.seed, lower=0)
        for name in ("incomplete", "reference", "up", "front", "origin"):
            value = getattr(self, name)
            if not isinstance(value, str):
                raise OptionsError(f"{name}: expected text, got {value!r}")
            object.__setattr__(self, name, composed(value))
        self._check_frame()
        if self.gauge == "axes" and self.reference:
            raise OptionsError(
                "reference: the gauge 'axes' takes no reference; choose one of the two"
            )
        if self.clusters > 1 and self.synchronization != "robust":
            raise OptionsError("clusters: only the robust synchronization splits a collection")
        if self.certify and self.embedding.has_eigenfunctions:
            raise OptionsError(
                "certify: no proofs with eigenfunctions; choose embedding kind xyz+invariants"
            )
        if self.seed >= _SEED_LIMIT:
            raise OptionsError(f"seed: expected an integer from 0 to 2^63 - 1, got {self.seed!r}")

    @property
    def rotates_frame(self) -> bool:
        """Whether landmarks or numbers rotate the common frame."""
        return not {self.up, self.front} <= {"", *FRAME_AXES}

    def _check_frame(self) -> None:
        for name in ("up", "front"):
            value = getattr(self, name)
            is_pair = value.count(":") == 1 and all(value.split(":"))
            if value and value not in FRAME_AXES and not is_pair and numbers_of(value) is None:
                raise OptionsError(
                    f"{name}: expected {', '.join(FRAME_AXES)}, two landmarks (base:vertex) or three numbers, "
                    f"got {value!r}"
                )
        if self.front and not self.up:
            raise OptionsError("front: say also which way is up")
        if self.up in FRAME_AXES and self.up[-1] == self.front[-1:] and self.front in FRAME_AXES:
            raise OptionsError(f"front: {self.front!r} and up, {self.up!r}, are on one axis")
        if self.gauge == "axes" and (self.up or self.origin):
            raise OptionsError(
                "up: the gauge 'axes' has no reference whose axes have names; choose one of the two"
            )


class AlignKeywords(TypedDict, total=False):
    """The fields of :class:`AlignOptions` as keywords."""

    preset: Preset
    group: Group
    scaling: Scaling
    pairs: PairStrategy
    synchronization: Synchronizer
    maps: Maps
    incomplete: str
    ignore_extra: bool
    refine: bool
    deformable: bool
    reference: str
    gauge: Gauge
    up: str
    front: str
    origin: str
    clusters: int
    seed: int
    certify: bool
    certify_budget_s: float
    certify_pair_s: float
    strict: bool
    cleaning: CleaningOptions | CleaningKeywords
    sampling: SamplingOptions | SamplingKeywords
    embedding: EmbeddingOptions | EmbeddingKeywords
    matching: PairOptions | PairKeywords


@dataclass(frozen=True, kw_only=True)
class TwoShapeOptions:
    """What decides how two shapes are matched by themselves, without a collection.

    Parameters
    ----------
    preset : {"default", "paper"}
        default searches rotations and keeps the best candidates; paper rounds PM-SDP over conv SO(3) at 20 points,
        positions and 4 Laplace-Beltrami coordinates (Maron et al. 2016), without refinement. An option that differs
        from its own default wins over the preset.
    group : {"SO", "O"}
        SO keeps the source as it is; O may reflect it.
    refine : bool
        Refine the poses on dense samples (``sampling.num_dense_points``).
    certify : bool
        Try to prove the best pose, in the seconds of ``matching.time_limit_s``, 30 by default.
    seed : int
        Seed of everything random.
    cleaning : CleaningOptions
        How meshes are repaired.
    sampling : SamplingOptions
        Which points represent a shape.
    embedding : EmbeddingOptions
        Which coordinates the points carry.
    matching : PairOptions
        How the pair is matched.

    Raises
    ------
    OptionsError
        If a value is impossible.
    """

    #: What is said of an option of :class:`AlignOptions` given for two shapes, see :func:`suggested_option`.
    advice: ClassVar[Mapping[str, str]] = {
        "scaling": "two shapes are matched up to scale, and the transform says by how much; align_collection has "
        "scaling, and match_in_part keeps sizes with sampling={'normalisation': 'none'}"
    }

    preset: Preset = "default"
    group: Literal["SO", "O"] = "SO"
    refine: bool = True
    certify: bool = False
    seed: int = 0
    cleaning: CleaningOptions = field(default_factory=CleaningOptions)
    sampling: SamplingOptions = field(default_factory=SamplingOptions)
    embedding: EmbeddingOptions = field(default_factory=EmbeddingOptions)
    matching: PairOptions = field(default_factory=PairOptions)

    def __post_init__(self) -> None:
        check_kinds(self)
        _apply(PRESETS[self.preset], self)
        check_count("seed", self.seed, lower=0)

    @property
    def of_pair(self) -> MatchOptions:
        """The options of :func:`pairwise.match`."""
        found = MatchOptions(**vars(self.matching), certify=self.certify, seed=self.seed)
        return (
            replace(found, time_limit_s=PROOF_S)
            if self.certify and found.time_limit_s is None
            else found
        )


class TwoShapeKeywords(TypedDict, total=False):
    """The fields of :class:`TwoShapeOptions` as keywords."""

    preset: Preset
    group: Literal["SO", "O"]
    refine: bool
    certify: bool
    seed: int
    cleaning: CleaningOptions | CleaningKeywords
    sampling: SamplingOptions | SamplingKeywords
    embedding: EmbeddingOptions | EmbeddingKeywords
    matching: PairOptions | PairKeywords


def numbers_of(text: str) -> list[float] | None:
    """Return three numbers that are separated by commas, None where a text is anything else."""
    try:
        return [float(one) for one in text.split(",")] if _THREE_NUMBERS.fullmatch(text) else None
    except ValueError:
        return None


def _apply(preset: Mapping[str, Any], options: AlignOptions | TwoShapeOptions) -> None:
    """Set the options of a preset that are there and at their defaults, in place."""
    known = {one.name: one for one in fields(options)}
    for name, value in preset.items():
        if name not in known:
            continue
        given, default = getattr(options, name), _default(known[name])
        if is_dataclass(given):
            table = {
                key: new
                for key, new in value.items()
                if getattr(given, key) == getattr(default, key)
            }
            value = replace(given, **table)  # type: ignore[type-var]
        elif given != default:
            continue
        object.__setattr__(options, name, value)


def _default(option: Field[Any]) -> Any:
    """Return what an option is that no user has changed."""
    return option.default if option.default_factory is MISSING else option.default_factory()


#: The session of an alignment.
AlignSession: TypeAlias = Session[AlignOptions]
