"""What a surface is: cleaning, topology, normals, geodesics, Laplacian."""
