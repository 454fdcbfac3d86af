"""Maps of deformable surfaces, arrays in, results out (Maron et al. 2016, section 6.1, and beyond)."""
