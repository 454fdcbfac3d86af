"""Landmarks of a few specimens carried to all others, with error radii."""
