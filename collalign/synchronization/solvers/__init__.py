"""The methods that synchronize."""
