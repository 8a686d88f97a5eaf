"""Turn a line drawing into the parameters of a procedural family, and so into a mesh.

`families` declares what can be drawn, `looking` looks at a drawing without torch, and `guesses` puts both together;
`training/sketch` draws as hands do and trains the network. Source: Huang, Kalogerakis, Yumer, Mech 2017, "Shape
Synthesis from Sketches via Procedural Models and Convolutional Networks"; the networks here are much smaller.
"""
