"""The command line, one module per command; each imports its dependencies when it runs."""
