"""Score distillation: the diffusion prior's denoising direction as a gradient on the picture.

    z_t  = sqrt(abar_t) z_0 + sqrt(1 - abar_t) eps          timestep ~ U(t_min, t_max(step)) T
    grad = (1 - abar_t) (eps_hat(z_t; prompt, s) - eps)     put straight onto z_0

The gradient does not pass through the denoiser. It is divided by the number of elements of z_0, so that a weight means
nearly the same for a small pixel prior and for Stable Diffusion's latents. The upper bound of the timestep can move
linearly over the run: coarse shape first, detail later.

Sources: Poole et al. 2022, DreamFusion, eq. 3; Ho and Salimans 2022, eq. 6 (in diffusers' convention of s);
Xu et al. 2024, FusionDeformer, eq. 5.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from meshdeform.errors import NumericalError
from meshdeform.guidance.base import StepContext
from meshdeform.priors.base import Prior

__all__ = ["ScoreDistillation"]


class ScoreDistillation:
    """Guidance by a diffusion prior and a prompt; the prompt is encoded once.

    Parameters
    ----------
    prior : Prior
    prompt, negative_prompt : str
    guidance_scale : float
        s in ``uncond + s * (text - uncond)``.
    timestep_min, timestep_max, timestep_max_end : float
        Bounds of the draw as fractions of T; the upper one moves from `timestep_max` to `timestep_max_end`.
    """

    def __init__(
        self,
        prior: Prior,
        prompt: str,
        *,
        negative_prompt: str = "",
        guidance_scale: float = 100.0,
        timestep_min: float = 0.02,
        timestep_max: float = 0.98,
        timestep_max_end: float = 0.98,
    ) -> None:
        self.style = prior.style
        self.identity = {"kind": "sds", **prior.identity}
        self._prior = prior
        self._embedding = prior.encode_prompt(prompt, negative_prompt)
        self._scale = guidance_scale
        self._low, self._high, self._high_end = timestep_min, timestep_max, timestep_max_end

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """The scalar whose gradient on z_0 is the score distillation gradient; see `Guidance.loss`."""
        prior = self._prior
        timestep = self._draw_timestep(context)
        z_0 = prior.encode_image(image, context.generator)
        noise = torch.randn(z_0.shape, generator=context.generator, dtype=torch.float32).to(z_0)
        with torch.no_grad():
            level = prior.alphas_cumprod[timestep].to(z_0)
            z_t = level.sqrt() * z_0 + (1 - level).sqrt() * noise
            predicted = prior.predict_noise(
                z_t, torch.tensor([timestep], device=z_t.device), self._embedding, self._scale, context.cameras
            )
            gradient = (1 - level) * (predicted.to(z_0) - noise) / z_0.numel()
            norm = float(gradient.float().norm()) * math.sqrt(z_0.numel())
        if not math.isfinite(norm):
            raise NumericalError(f"The diffusion prior's prediction is not finite at timestep {timestep}.")
        # The value itself means nothing in score distillation; its gradient on z_0 is exactly `gradient`.
        return (gradient * z_0).sum(), {"sds_gradient": norm, "timestep": float(timestep)}

    def _draw_timestep(self, context: StepContext) -> int:
        high = self._high + (self._high_end - self._high) * context.progress
        u = torch.rand((), generator=context.generator, dtype=torch.float64).item()
        steps = self._prior.num_timesteps
        return min(max(int((self._low + (high - self._low) * u) * steps), 0), steps - 1)
