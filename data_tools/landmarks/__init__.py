"""Files of landmarks, in the formats of the field."""
