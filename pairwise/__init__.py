"""Procrustes matching of two point sets: relaxations, certificates, search, refinement. Arrays in, results out."""
