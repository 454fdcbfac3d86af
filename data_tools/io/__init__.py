"""Files to shapes and landmarks, and back."""
