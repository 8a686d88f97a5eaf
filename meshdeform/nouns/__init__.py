"""The shapes of nouns: families that draw members, the names of their parts, and their poses. No torch.

`families` has a function for each noun, `labels` names the faces of a member, `poses` moves its limbs.
"""
