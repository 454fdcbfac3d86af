"""All places, in the order in which they are tried."""

from __future__ import annotations

from tests.mutants.collections import COLLECTIONS, ENGINE, NONRIGID, SHAPES
from tests.mutants.proofs import MATCHING, VERIFIERS

MUTANTS = (*VERIFIERS, *MATCHING, *COLLECTIONS, *ENGINE, *NONRIGID, *SHAPES)
