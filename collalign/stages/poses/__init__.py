"""From pairs that partly contradict each other to one pose per shape.

* ``synchronize``: from pairs to poses
* ``refinement``: on dense samples
* ``bent``: averages over several ways
* ``agreement``: pairs at the common poses
* ``placement``: gauge, origin, labels, sizes
"""
