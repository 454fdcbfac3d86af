"""A lower bound of the energy of all consistent arrangements of a collection, and the cheapest arrangement known."""
