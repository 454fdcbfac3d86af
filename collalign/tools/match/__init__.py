"""Two shapes: poses, poses of parts, or a map between deformable surfaces; lists of pairs."""
