"""What stays when an alignment is repeated otherwise."""
