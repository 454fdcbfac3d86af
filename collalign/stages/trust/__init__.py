"""How far each pose can be trusted, from evidence that the answer did not make.

* ``assess``: all evidence, and the confidence
* ``blocks``: shapes that one wrong rotation keeps together
* ``rival_poses``: of pairs, and of near symmetries
* ``trust_notes``: what the user is told
"""
