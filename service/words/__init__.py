"""Words of owners' own: add, list, show, export and delete them, and let jobs know them."""
