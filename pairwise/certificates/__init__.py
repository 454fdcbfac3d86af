"""Lower bounds that anybody can check: the file format, and verifiers that share no code with the solvers.

* ``certificate``: files
* ``verify``: the entry, and the bound of all shapes together
* ``verify_pm_sdp``, ``verify_cells``: of the relaxation; of branch and bound
"""
