"""Public collections and generated ones."""
