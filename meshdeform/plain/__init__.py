"""Change an asset in plain words, "longer legs and a bigger head", without a model.

`words` reads a sentence into changes, in pure Python; `body` is the asset as it stands; `parts` finds what a word
names on it; `maps` moves the vertices; `change` puts these together and checks what came of it; `naming`
lists what can be named.
"""
