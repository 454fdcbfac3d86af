"""Generated collections that experiments are measured on: animals, bodies of several kinds, objects, rooms."""
