"""The evidence of the pose of every shape."""

from __future__ import annotations

from dataclasses import dataclass

from data_tools.arrays import FloatArray

#: Poses below this confidence are called doubtful, on the command line, in the contact sheet and in the report.
DOUBT = 0.95
#: Shapes below this one get further pairs; lower than what is called doubtful in the end, because few pairs say less
#: than they will.
UNCERTAIN = 0.9
#: Kinds of evidence about a pose, the columns of :attr:`Trust.evidence`.
KINDS = (
    *("votes", "margin", "collection votes", "lead", "misfit"),
    *("local margin", "mismatch", "local misfit", "cycles", "block margin"),
)
#: The positions of these columns.
VOTES, MARGIN, COLLECTION_VOTES, LEAD, MISFIT, *_ = range(len(KINDS))
LOCAL_MARGIN, MISMATCH, LOCAL_MISFIT, CYCLES, BLOCK_MARGIN = range(MISFIT + 1, len(KINDS))


@dataclass(frozen=True, kw_only=True, eq=False)
class Trust:
    """Evidence about the poses of a collection that its poses did not make.

    Attributes
    ----------
    evidence : ndarray, shape (N, len(KINDS))
        One row per shape, NaN where nothing is known (a shape without a pair).

        * votes: share of its pairs, as first matched, whose most plausible candidate asks for the pose, with half a
          vote added on either side;
        * margin: log of what the cheapest other pose costs on dense points over what the pose costs, mean over the
          partners that match best;
        * collection votes: mean of the votes over the shapes that it can be compared with;
        * lead: how much more plausible its pairs, as first matched, find the pose than its strongest rival, in
          log-odds, mean over all pairs;
        * misfit: log of what the pose costs on dense points over that of the median shape that it is compared with;
        * local margin: as the margin, of the mismatch of neighbourhoods in place of dense points, .05 added to each;
        * mismatch: of neighbourhoods with the most similar partner (:attr:`collalign.results.Pair.mismatches`);
        * local misfit: log of this mismatch, .05 added, over that of the median shape that it is compared with;
        * cycles: log-odds that the pairs of all shapes that it can be compared with, as first matched, know the poses
          and do not choose between two at random (:func:`collalign.confidence.pose_model.cycle_log_odds`);
        * block margin: margin and local margin together of the least certain block of shapes that it belongs to,
          rotated as one (:func:`collalign.stages.trust.blocks.block_margins`). A wrong rotation keeps such a block
          together, so that the shapes in it support one another.

        Pairs with a shape that resembles no other one count for that shape alone. What is said of neighbourhoods is
        NaN where surfaces have too few points for neighbourhoods.
    rivals : tuple of ndarray, each (r, 3, 3)
        Other poses of each shape, ``R_common_shape``.
    excess : tuple of ndarray, each (r,)
        The margin of each of them.
    local_excess : tuple of ndarray, each (r,)
        The local margin of each of them.
    leads : tuple of ndarray, each (r,)
        The lead over each of them.
    symmetries : tuple of ndarray, each (t, 3, 3)
        Rotations of the common frame after which the shapes of its part look alike, the identity first; for each
        shape.
    up_to_symmetry : ndarray, shape (N, len(KINDS))
        The evidence where poses that differ by such a rotation count as one.
    """

    evidence: FloatArray
    rivals: tuple[FloatArray, ...]
    excess: tuple[FloatArray, ...]
    local_excess: tuple[FloatArray, ...]
    leads: tuple[FloatArray, ...]
    symmetries: tuple[FloatArray, ...]
    up_to_symmetry: FloatArray
