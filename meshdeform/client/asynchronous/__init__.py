"""Hold the client for event loops, of which `scripts/sync_client.py` makes the one for threads."""
