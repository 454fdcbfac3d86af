"""Smooth, fold-free maps of one posed surface to another: arrays in, frozen results out; no files, no processes.

* ``register``: by closest points
* ``by_map``: along a map
* ``surface``: what both are given, and their tuned numbers (``RegistrationTuning``)
"""
