"""A result in the formats of the field.

* ``run``: the entry; ``FORMATS`` lists all
* ``formats``: landmarks and meshes
* ``tables``: CSV, Parquet
* ``request``: what a format is given
* ``command``: prints and writes

A new format is a function of an ``ExportRequest`` in ``formats`` with its line in ``FORMATS``.
"""
