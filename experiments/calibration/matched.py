"""Shapes of a public collection in random poses, with all pairs matched: what several calibrations start from."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from collalign.engine.run_options import RunOptions
from collalign.engine.session import Session
from collalign.options import AlignOptions, AlignSession
from collalign.products.pair import Pair
from collalign.products.shapes import Shapes
from collalign.stages.choose_pairs import all_pairs
from collalign.stages.match_pairs import match_pairs
from collalign.stages.shape_stage import prepare_shapes
from data_tools.io.objects import list_shapes
from experiments.collections.aligning import pose_some
from experiments.collections.posed import PosedCollection


@dataclass(frozen=True, kw_only=True, eq=False)
class Matched:
    """Posed shapes and their matched pairs, while their session is open."""

    posed: PosedCollection
    session: AlignSession
    shapes: Shapes
    pairs: list[Pair]


@contextmanager
def matched(data: Path, collection: str, num: int, options: AlignOptions) -> Iterator[Matched]:
    """Pose some shapes of a collection at random and match all their pairs; ``options`` have a decided group."""
    with tempfile.TemporaryDirectory() as name:
        posed, _ = pose_some({"collection": collection, "shapes": num, "seed": 0}, data, Path(name))
        with Session.open(options, RunOptions(jobs=1), None) as session:
            shapes = prepare_shapes(session, list_shapes(name))
            pairs, _ = match_pairs(session, shapes, all_pairs(len(shapes.names)))
            yield Matched(posed=posed, session=session, shapes=shapes, pairs=pairs)
