"""Lower bounds that anybody can check: the file format and verifiers that share no code with the solvers."""
