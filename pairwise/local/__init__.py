"""Local minimisation from many starts."""
