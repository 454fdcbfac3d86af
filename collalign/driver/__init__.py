"""Takes the shapes of one kind, or of several, through the stages, and makes the result.

* ``one_kind``: a task, the shapes that are aligned together, through all stages
* ``several_kinds``: a task of each kind, and the frames of the kinds to each other
* ``join_kinds``: results of several kinds as one
* ``made``: the result of a run
"""
