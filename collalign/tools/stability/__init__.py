"""What stays when an alignment is repeated otherwise.

* ``run``: repeats and compares
* ``command``: prints and writes
"""
