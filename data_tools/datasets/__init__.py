"""Generated collections."""
