"""Files to shapes, and back."""
