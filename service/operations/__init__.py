"""Tell how the server does and what it allows: health, metrics, limits, models."""
