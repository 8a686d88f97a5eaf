"""Document the API: the HTML reference, the links between operations, and shared responses and headers."""
