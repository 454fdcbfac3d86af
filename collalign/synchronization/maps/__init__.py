"""Maps and shapes of a whole collection: permutations, superimposition."""
