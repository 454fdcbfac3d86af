"""Samples of a shape and the coordinates they carry."""
