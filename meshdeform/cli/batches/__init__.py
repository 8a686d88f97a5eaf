"""Batches: the rows of a manifest, the runners that process them, and the ledger of their states."""
