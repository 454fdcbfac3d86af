"""How far stated confidences can be believed: random sub-collections of everything at hand."""
