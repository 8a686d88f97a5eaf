"""Benchmark how well results show their prompts, and the quality of their meshes. See docs/quality.md."""
