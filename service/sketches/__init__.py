"""Read drawings, and make the shapes that they show."""
