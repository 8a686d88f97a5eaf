"""Turn a line drawing into the parameters of a procedural family, and so into a mesh.

`families` declares what can be drawn, `lines` and `strokes` draw it as hands do, `network` learns to look at drawings,
`looking` looks without torch, and `guesses` puts all together. Source: Huang, Kalogerakis, Yumer, Mech 2017, "Shape
Synthesis from Sketches via Procedural Models and Convolutional Networks"; the networks here are much smaller.
"""
