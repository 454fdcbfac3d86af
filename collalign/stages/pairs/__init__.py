"""Which pairs are matched, and how."""
