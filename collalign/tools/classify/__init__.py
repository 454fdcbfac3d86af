"""Every shape by its nearest neighbour."""
