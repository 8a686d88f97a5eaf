"""See six sides of a shape at once: MV-Adapter over a Stable Diffusion 2.1 checkpoint."""
