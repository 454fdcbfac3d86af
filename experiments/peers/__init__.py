"""Other tools on the same shapes."""
