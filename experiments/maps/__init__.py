"""Maps between deformable surfaces."""
