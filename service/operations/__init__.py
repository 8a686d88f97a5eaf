"""Report health, metrics, limits and models."""
