"""A result in the formats of the field."""
