"""Pairs of shapes: how well they are matched."""
