"""Turn a line drawing into a shape of a noun with sliders.

`looking` says at first sight which nouns it may show, `lines` draws members of them, `matching` says how far their
lines are from the drawing, and `guessing` puts these together; `shapes` makes shapes by sliders. `training/sketch` fits
what `looking` looks with.
"""

NAMES = ()
