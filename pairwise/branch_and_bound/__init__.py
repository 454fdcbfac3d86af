"""Proofs of the best pose by branch and bound over rotations."""
