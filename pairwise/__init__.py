"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""

from pairwise.certificate import Certificate
from pairwise.match import match
from pairwise.options import MatchOptions
from pairwise.solve import solve_relaxation
from pairwise.verify import verify_certificate

__all__ = ["Certificate", "MatchOptions", "match", "solve_relaxation", "verify_certificate"]
