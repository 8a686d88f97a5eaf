"""Document the API: the document, and shared responses and headers."""
