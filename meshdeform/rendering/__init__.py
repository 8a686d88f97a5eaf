"""Draw a mesh differentiably: cameras, rasterizer, shading, and the combination of four views in one image."""
