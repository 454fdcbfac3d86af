"""The relaxations written down plainly in CVXPY, to compare with."""
