"""A surface as non-rigid matching sees it: spectrum, signatures, orientation."""
