"""Create the guidance `sds` from the parameters of a job; the only place that maps one to the other."""

from __future__ import annotations

from collections.abc import Sequence

from meshdeform.errors import ModelError
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.guidance.texts import WeightedPrompt
from meshdeform.priors.base import HasEncoders, Prior
from meshdeform.rendering.shading import Shading
from meshdeform.requests.choices import AppearanceMode, Encoder
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.models import is_builtin

__all__ = ["score_distillation"]

_SHADINGS: dict[AppearanceMode, Shading] = {
    AppearanceMode.NORMALS: "normals",
    AppearanceMode.CLAY: "lambert",
    AppearanceMode.TEXTURED: "textured",
    AppearanceMode.MIXED: "mixed",
}


def score_distillation(
    prior: Prior, prompt: str | Sequence[WeightedPrompt], params: ResolvedParams
) -> ScoreDistillation:
    """Return the guidance `sds` of a job with these parameters.

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use this prompt.
    ModelError
        The prior has no such encoder.
    """
    if isinstance(prior, HasEncoders):
        prior = prior.with_encoder(params.encoder)
    elif params.encoder is not Encoder.VAE:
        raise ModelError(f"This model has no encoder {params.encoder!r}.", advice="Leave params.encoder out.")
    return ScoreDistillation(
        prior,
        prompt,
        negative_prompt=params.negative_prompt,
        guidance_scale=params.guidance_scale,
        guidance_rescale=params.guidance_rescale,
        timestep_min=params.timestep_min,
        timestep_max=params.timestep_max,
        timestep_max_end=params.timestep_max_end,
        # Parameters resolved by an earlier edition have no appearance, and this model takes only its own.
        shading=None if is_builtin(params.model) else _SHADINGS[params.appearance],
    )
