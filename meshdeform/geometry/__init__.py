"""Triangle meshes: connectivity, differential operators, welding, normals, quality. No rendering, no optimisation."""
