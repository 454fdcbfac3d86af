"""Six small generated collections with the stored results of their alignment."""
