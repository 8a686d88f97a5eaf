"""Deform a mesh as in the paper, with a few additions of our own.

`poisson` implements eq. 6 of the paper, `loop` one optimisation step (eq. 7 and 8), `regularizers` eq. 9
to 13. `variables` holds what is optimised. `lattice_field` (assets of several components), `stand_in` and
`surface_guard` are not in the paper; our presets add them.

Source: Xu et al. 2024, FusionDeformer.
"""
