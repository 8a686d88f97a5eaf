"""The shapes of nouns: members of families, the names of their parts, and their poses. numpy and scipy, no torch.

`families` has a function for each noun, `solids` a line for each that names its solids, `labels` members with a part
on every face. `poses` moves limbs; `forms` draws a noun otherwise than its family, such as a bear on four legs.
"""
