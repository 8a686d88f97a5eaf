"""What the presets have in place of the paper's values, for each kind of guidance.

The paper's values themselves are the defaults in `meshdeform.requests.parameters`.
"""

from __future__ import annotations

from typing import Any, Literal

__all__ = ["OVERRIDES", "Family"]

Family = Literal["builtin", "sd", "target"]

# What a preset of ours never does to a surface.
_GUARDED: dict[str, Any] = {"safeguard": "intersections"}

# A difference of pictures in tenths is a smaller number than score distillation's sum over 16,384 latents.
_TARGET: dict[str, Any] = {
    "jacobian_reg_weight": 0.1,
    "laplacian_weight": 1e-3,
    "normal_weight": 10.0,
    "framing": 0.57,
    "framing_max": 1.0,
}


# The builtin prior has learned from pictures of shapes that the unit sphere holds.
_BUILTIN_VIEW: dict[str, Any] = {"framing": 0.57, "framing_max": 1.0}

# The builtin prior is small: below 0.75 T it mostly cleans up the picture it is given, above it says what to draw.
# Twelve times the paper's rate is bearable because the guard takes back what such steps do wrong, and because rescaled
# guidance asks for no harsher picture than the prior knows (docs/quality.md, Results).
_BUILTIN: dict[str, Any] = {
    **_GUARDED,
    "learning_rate": 0.03,
    "translation_rate": 1.0,
    "attachment_weight": 2000.0,
    "guidance_scale": 7.5,
    "guidance_rescale": 0.7,
    "timestep_min": 0.75,
    **_BUILTIN_VIEW,
    "jacobian_reg_weight": 16.0,
    "laplacian_weight": 0.16,
    "normal_weight": 6000.0,
    # Halves the distortion at the same retrieval (docs/quality.md, The barrier). Other priors and targets
    # pull with other strengths; what weight suits them was not measured.
    "dirichlet_weight": 10.0,
}

# Regularisers and framing of our own for Stable Diffusion: the paper's regularisers are next to nothing beside the pull
# of score distillation, and a shape that may grow in the picture before the camera follows is seen to have grown. Not
# measured: no such model can be run here.
_SD: dict[str, Any] = {
    **_GUARDED,
    "translation_rate": 1.0,
    "attachment_weight": 2000.0,
    "jacobian_reg_weight": 16.0,
    "laplacian_weight": 0.16,
    "normal_weight": 1600.0,
    "framing": 0.75,
    "framing_max": 0.95,
    "timestep_max_end": 0.5,
}

# Only what differs from the paper. `paper` stays the paper, except that the builtin prior needs its own scale.
OVERRIDES: dict[tuple[Family, str], dict[str, Any]] = {
    ("builtin", "paper"): {"guidance_scale": 7.5, **_BUILTIN_VIEW},
    ("builtin", "balanced"): {**_BUILTIN, "steps": 200},
    ("builtin", "preview"): {**_BUILTIN, "steps": 80},
    ("sd", "paper"): {},
    ("sd", "balanced"): {**_SD, "steps": 2000, "learning_rate": 0.005},
    ("sd", "preview"): {**_SD, "steps": 300, "learning_rate": 0.01},
    ("target", "paper"): _TARGET,
    ("target", "balanced"): {
        **_TARGET,
        **_GUARDED,
        "steps": 600,
        "learning_rate": 0.01,
        "translation_rate": 1.0,
        "attachment_weight": 20.0,
    },
    ("target", "preview"): {
        **_TARGET,
        **_GUARDED,
        "steps": 300,
        "learning_rate": 0.01,
        "translation_rate": 1.0,
        "attachment_weight": 20.0,
    },
}
