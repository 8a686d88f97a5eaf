"""Neural displacement fields: a coarse base mesh and a small network that maps it to a surface.

Read in the order of the paper: `surface_sources` (project a point to the surface), `cleaning` and `base_mesh`
(the coarse mesh), `network` (the map), `fitting` (its optimisation), `container` and `reader` (the file `.ndf`),
`intrinsic` (Delaunay flips, Laplacian, spectrum, geodesics), `measures` (the report).

Source: Noma, Wang, Liu, Singh and Jacobson 2026, Mesh Processing Non-Meshes via Neural Displacement Fields.
"""
