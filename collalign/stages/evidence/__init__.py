"""Further evidence of a pair's poses: dense points, normals, and the non-rigid maps that the poses start."""
