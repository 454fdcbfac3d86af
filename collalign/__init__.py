"""Aligns a collection of shapes consistently."""
