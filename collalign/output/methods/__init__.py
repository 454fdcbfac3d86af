"""What a methods section says: sentences of the alignment and of tools, with their references."""
