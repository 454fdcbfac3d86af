"""Shapes: reading, cleaning, sampling, spectral operators, embeddings, generated collections and public datasets."""
