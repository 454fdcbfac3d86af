"""Poses of two surfaces that overlap in part: rotation, shift and scale searched, trimmed closest points."""
