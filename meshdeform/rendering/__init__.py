"""Render a mesh differentiably: cameras, rasterizer, shading, and the combination of four views into one image."""
