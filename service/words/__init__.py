"""Let jobs know the words of their owners."""
