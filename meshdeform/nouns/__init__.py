"""The shapes of nouns: members of families, the names of their parts, and their poses. numpy and scipy, no torch.

`families` has a function or a sketch for each noun, `labels` members with a part on every face. `poses` moves limbs;
`forms` draws a noun otherwise than its family, such as a bear on four legs.
"""
