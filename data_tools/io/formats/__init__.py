"""Readers of mesh and point cloud formats that are not a table of numbers, one module a format."""
