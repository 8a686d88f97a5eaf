"""Train the network that reads line drawings.

`lines`, `habits` and `strokes` draw members of the families as people do, `strangers` draws what is of none, and
`train` trains the network of `network`.
"""
