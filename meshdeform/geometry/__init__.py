"""Represent triangle meshes: connectivity, differential operators, welding, normals, quality."""
