"""PM-SDP and its dual interior-point solver.

* ``lifted_rotation``, ``data``, ``moment_basis``: variables of R and equations of their moments; costs and matches as
  arrays; coordinates of the moments
* ``interior_point``, ``steps``, ``variables``: the solver, its steps and iterates
* ``newton``, ``newton_blocks``: its linear system; the blocks of one source point each
* ``rounding``: starts for local search
* ``certify``: from the dual to a bound
* ``cvxpy_model``, ``cvxpy_solve``: PM-SDP as the paper writes it, SCS and Clarabel; tests and experiments compare the
  solver with them

Word: **certify** is to write a proof down so that anybody can check it; *prove* is to find it, *verify* to check it.
"""
