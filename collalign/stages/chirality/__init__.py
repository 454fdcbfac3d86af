"""Whether a folder mixes left and right specimens."""
