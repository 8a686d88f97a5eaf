"""Write USDZ with Pixar's library, the extra `usd`."""
