"""Shapes of which parts are missing: found, and posed on the complete ones by what has a counterpart."""
