"""Score distillation: a diffusion model's denoising direction as a gradient on the rendered views.

::

    z_t       = sqrt(abar_t) z0 + sqrt(1 - abar_t) eps        t ~ U(timestep_min T, tau(step) T),  eps ~ N(0, I)
    eps_hat   = eps(z_t; nothing) + s (eps(z_t; prompt) - eps(z_t; nothing))
    d loss/dz0 = k (1 - abar_t) (eps_hat - eps)               k = 16384 / (number of elements of z0)

The gradient goes straight onto z0; the network itself is never differentiated. tau moves linearly from
`timestep_max` to `timestep_max_end` over the run.

A model with more latents gives a longer gradient for the same picture: the sum over the elements of z0 grows with
their number, and with it the pull on the mesh against the regularisers. k takes that out. It is 1 for the 4 x 64 x 64
latents of Stable Diffusion at 512 pixels, where the published weights hold, and 1/3 for a model on 3 x 128 x 128
pixels, so `guidance_weight` means the same for every prior.

Sources: Poole et al. 2023, DreamFusion, eq. 3 (gradient); Xu et al. 2024, FusionDeformer (weighting 1 - abar_t);
Ho & Salimans 2022, eq. 6, in diffusers' convention of s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from meshdeform.errors import NumericalError, ParameterError
from meshdeform.guidance.base import StepContext

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior
    from meshdeform.shading import RenderStyle

__all__ = ["REFERENCE_ELEMENTS", "ScoreDistillation"]

REFERENCE_ELEMENTS = 4 * 64 * 64
"""Elements of z0 for which k is 1: Stable Diffusion at 512 pixels."""


class ScoreDistillation:
    """Pulls the views towards what a diffusion prior makes of the prompt.

    Parameters
    ----------
    prior : Prior
    prompt, negative_prompt : str
        Encoded here, once; a job makes one of these objects.
    guidance_scale : float
        s.
    timestep_min : float
        Lowest timestep drawn, as a fraction of T.
    timestep_max, timestep_max_end : float
        Highest timestep drawn at the first and at the last step, as fractions of T.

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use this text, or the timestep bounds are not 0 <= min <= max <= 1.
    """

    def __init__(
        self,
        prior: Prior,
        prompt: str,
        *,
        negative_prompt: str = "",
        guidance_scale: float,
        timestep_min: float = 0.02,
        timestep_max: float = 0.98,
        timestep_max_end: float = 0.98,
    ) -> None:
        if not 0 <= timestep_min <= min(timestep_max, timestep_max_end) <= max(timestep_max, timestep_max_end) <= 1:
            raise ParameterError(
                f"Timesteps must have 0 <= timestep_min ({timestep_min}) <= timestep_max ({timestep_max}) and "
                f"timestep_max_end ({timestep_max_end}) <= 1."
            )
        self._prior = prior
        self._embedding = prior.encode_prompt(prompt, negative_prompt)
        self._scale = guidance_scale
        self._bounds = (timestep_min, timestep_max, timestep_max_end)

    @property
    def style(self) -> RenderStyle:
        """How the prior wants the views drawn."""
        return self._prior.style

    @property
    def identity(self) -> dict[str, str]:
        """The prior's."""
        return self._prior.identity

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Draw a timestep and noise, ask the prior, and put its direction onto z0.

        Parameters
        ----------
        image : (1, 3, S, S) float32 in [0, 1]
        context : StepContext

        Returns
        -------
        ``k (1 - abar_t) / 2 ||eps_hat - eps||^2``, the weighted denoising error, whose gradient with respect to z0 is
        the one above; and for the log `sds_mse`, the mean of ``(eps_hat - eps)^2``, `sds_gradient_norm`, the length of
        the gradient on z0, and `timestep`. The error depends on t as much as on progress: compare averages.

        Raises
        ------
        NumericalError
            The prediction or z0 is not finite.
        """
        prior, generator = self._prior, context.generator
        z0 = prior.encode_image(image, generator)
        timestep = self._draw_timestep(context)
        noise = torch.randn(z0.shape, generator=generator, dtype=torch.float32).to(z0.device)
        with torch.no_grad():
            level = prior.alphas_cumprod[timestep].view(1, 1, 1, 1).to(z0)
            noisy = level.sqrt() * z0 + (1 - level).sqrt() * noise
            predicted = prior.predict_noise(
                noisy, timestep.to(z0.device), self._embedding, self._scale, context.cameras
            )
            residual = predicted - noise
            weight = (1 - level) * (REFERENCE_ELEMENTS / z0.numel())
            gradient = weight * residual
            value = 0.5 * (gradient * residual).sum()
            norm = gradient.norm()
        logs = {
            "sds_mse": residual.square().mean().item(),
            "sds_gradient_norm": norm.item(),
            "timestep": float(timestep),
        }
        if not (torch.isfinite(value) and torch.isfinite(norm)):
            raise NumericalError(
                f"The diffusion prior's prediction at timestep {int(timestep)} is not finite.",
                advice="Lower guidance_scale; with a half-precision model, run it in float32.",
            )
        scalar: Tensor = _StraightThrough.apply(z0, value, gradient)  # type: ignore[no-untyped-call]
        return scalar, logs

    def timestep_bounds(self, context: StepContext) -> tuple[int, int]:
        """Lowest and highest timestep that may be drawn at this step, both inclusive."""
        last = self._prior.num_timesteps - 1
        low, high, high_end = self._bounds
        top = high + (high_end - high) * context.fraction
        lowest = min(round(low * self._prior.num_timesteps), last)
        return lowest, max(lowest, min(round(top * self._prior.num_timesteps), last))

    def _draw_timestep(self, context: StepContext) -> Tensor:
        low, high = self.timestep_bounds(context)
        return torch.randint(low, high + 1, (1,), generator=context.generator)


class _StraightThrough(torch.autograd.Function):
    """A scalar with a given value and a given gradient with respect to z0."""

    @staticmethod
    def forward(ctx: Any, z0: Tensor, value: Tensor, gradient: Tensor) -> Tensor:  # noqa: ARG004
        ctx.save_for_backward(gradient)
        return value.clone()

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return upstream * gradient, None, None
