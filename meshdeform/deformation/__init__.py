"""The paper, in the order of its sections.

`jacobians` and `poisson` are its section 4.1 (eq. 6), `loop` one optimisation step (eq. 4 and 8), `regularizers` its
section 4.3 (eq. 9 to 13). What the paper does not have, and our presets add: `attachments`, `step_limit`,
`surface_guard` and `face_blend`.

Source: Xu et al. 2024, FusionDeformer.
"""
