"""Generate pages of the documentation, and parts of pages, from the code."""
