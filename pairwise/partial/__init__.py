"""Poses of two surfaces that overlap in part: rotation, shift and scale searched, what has no counterpart left out."""
