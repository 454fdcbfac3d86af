"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""

from pairwise.match import match
from pairwise.options import MatchOptions

__all__ = ["MatchOptions", "match"]
