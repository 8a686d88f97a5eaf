"""Learn nouns from public collections of assets: which files show what, who made them, and who may learn from them."""
