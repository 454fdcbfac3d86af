"""How far each pose can be trusted, from evidence that the answer did not make."""
