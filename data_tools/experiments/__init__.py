"""The experiments: one command each, ``python -m data_tools.experiments NAME``, over public collections.

They use the whole toolkit, so this sub-package alone in ``data_tools`` imports ``pairwise`` and ``collalign``.
"""
