"""The graph of pairs, its checks, its geometry, its noise model."""
