"""Generated collections that experiments are measured on: bending animals, assembled objects, rooms."""
