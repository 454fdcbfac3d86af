"""All places, in the order in which they are tried; the faults that a draw makes are left to it."""

from tests.mutants import of_pairwise, of_poses, of_results, of_shapes
from tests.mutants.place import listed

MUTANTS = tuple(one for part in (of_pairwise, of_poses, of_results, of_shapes) for one in listed(part.FAULTS))
