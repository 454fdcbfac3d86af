"""Proofs of the best pose by branch and bound over rotations.

* ``bounds``: of cells of rotations
* ``assignment``: bounds of one-to-one matches
* ``exact_assignment``: the best one-to-one matches, for every search
* ``search``: of one chirality
* ``prove``, ``pose_lists``: the best pose; all poses
* ``tilted``: energies less a linear function
"""
