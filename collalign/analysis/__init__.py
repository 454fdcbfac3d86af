"""What aligned shapes say: statistics of arrays.

* ``procrustes``: mean shapes, sizes, distances, ordination, changes of poses
* ``shape_tests``: permutation tests, ANOVA
* ``symmetry``, ``paired_sides``: of one object; left and right of individuals
* ``measurement_error``: of shapes that were measured repeatedly
* ``integration``: partial least squares
* ``sliding``: of semilandmarks
* ``label_table``, ``label_checks``: tables of labels, and what is wrong with them
* ``left_out``: whether shapes that do not count differ from the others

Everything takes and returns arrays. What is public is named in ``collalign/statistics.py``. CONTRIBUTING.md walks
through a new statistic.

Word: **block**: landmarks whose integration is tested; elsewhere, coordinates or shapes that move together.
"""
