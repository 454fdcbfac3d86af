"""Two prepared shapes as wholes: their poses, and what their surfaces say of each.

* ``problem``: what :mod:`pairwise` takes of two shapes, and their match at a pose
* ``local_evidence``: neighbourhoods, overlap and gaps of dense points at poses, and poses that neighbourhoods propose
* ``match_whole``: the candidates of a pair, with the energy and the mismatch of each
"""
