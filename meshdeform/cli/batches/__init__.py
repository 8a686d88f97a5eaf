"""Batches: rows of a manifest, the ledger of their states, and the runners that process them."""
