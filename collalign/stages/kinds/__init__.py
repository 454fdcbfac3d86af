"""Which shapes of a collection are of one kind, and how the frames of kinds lie to each other."""
