"""Ways to start a map: eigenfunctions, the relaxation, and the tips of limbs; refinement and judgement come later."""
