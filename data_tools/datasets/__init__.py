"""Generated collections with their exact answers.

* ``synthetic``: copies that are bent, bumped, mirrored or seen from one side
* ``synthetic_shapes``: the shapes in them
"""
