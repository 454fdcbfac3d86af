"""The tight relaxation."""
