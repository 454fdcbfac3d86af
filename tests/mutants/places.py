"""All places, in the order in which they are tried."""

from tests.mutants.branch_and_bound import BRANCH_AND_BOUND
from tests.mutants.collections import COLLECTIONS, ENGINE, NONRIGID, SHAPES
from tests.mutants.incomplete import INCOMPLETE
from tests.mutants.proofs import MATCHING, VERIFIERS
from tests.mutants.surfaces import SURFACES
from tests.mutants.survivors import SURVIVORS
from tests.mutants.trust import TRUST

MUTANTS = (
    *VERIFIERS,
    *MATCHING,
    *BRANCH_AND_BOUND,
    *INCOMPLETE,
    *COLLECTIONS,
    *TRUST,
    *ENGINE,
    *NONRIGID,
    *SHAPES,
    *SURFACES,
    *SURVIVORS,
)
