"""A result in the formats of the field.

* ``run``: the entry; ``FORMATS`` lists all
* ``formats``: landmarks and meshes
* ``tables``: CSV, Parquet
* ``scans``: poses for tools of scans, one cloud of all
* ``request``: what a format is given
* ``command``: prints and writes

A new format is a function of an ``ExportRequest`` in ``formats`` with its line in ``FORMATS``.
"""
