"""The Procrustes matching problem."""
