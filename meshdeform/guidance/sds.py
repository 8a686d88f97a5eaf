"""Compute score distillation: a diffusion model's denoising direction as a gradient on the rendered views.

::

    z_t       = sqrt(abar_t) z0 + sqrt(1 - abar_t) eps        t ~ U(low(step) T, high(step) T),  eps ~ N(0, I)
    eps_hat   = eps(z_t; nothing) + s (eps(z_t; prompt) - eps(z_t; nothing))
    d loss/dz0 = k (1 - abar_t) (eps_hat - eps)               k = 16384 / (number of elements of z0)

The gradient is applied directly to z0; the network itself is never differentiated. The upper bound of t changes
linearly over the run, from `timestep_max` to `timestep_max_end`. A negative prompt replaces `nothing`.

A model with more latents gives a longer gradient for the same picture, because the sum over the elements of z0 grows
with their number, and with it the weight of the guidance against the regularisers. The factor k compensates for this.
It is 1 for the 4 x 64 x 64 latents of Stable Diffusion at 512 pixels, for which the weights were published, and 1/3 for
a model on 3 x 128 x 128 pixels, so `guidance_weight` has the same meaning for every prior. Views in separate pictures
share the weight.

Not in the paper: `guidance_rescale` phi reduces the standard deviation of the predicted clean picture, which a large s
inflates, to that of the prompted prediction::

    x0_hat <- x0_hat (phi std(x0_text) / std(x0_hat) + 1 - phi)

Several prompts share the picture, timestep, noise, and the prediction for nothing; all predictions are one batch. Their
gradients are added with their weights, which, if the weights add up to 1, is the conjunction of composable diffusion::

    sum_i w_i eps_hat_i = eps(z_t; nothing) + sum_i w_i s (eps(z_t; prompt_i) - eps(z_t; nothing))

Sources: Poole et al. 2023, DreamFusion, eq. 3 (gradient); Xu et al. 2024, FusionDeformer, eq. 7 (weighting 1 - abar_t);
Ho & Salimans 2022, eq. 6, in diffusers' convention of s; Lin et al. 2024, Common diffusion noise schedules, eq. 15 and
16 (rescaling); Liu et al. 2022, Compositional visual generation with composable diffusion models, concept conjunction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor

from meshdeform.errors import NumericalError, ParameterError
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.weighted import WeightedPrompt

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior
    from meshdeform.rendering.shading import RenderStyle, Shading

_DRAWS = 3
"""Draws of timestep and noise per step, so that one overflow in half precision does not end a long run."""
REFERENCE_ELEMENTS = 4 * 64 * 64
"""Elements of z0 for which k is 1: Stable Diffusion at 512 pixels."""


class Texts:
    """The encoded texts of a job.

    `prompts`: at least one; `rows`, (N, ...): rows for `Prior.predict_noise`: what guidance points away from, then the
    prompts. `pairs`, list of (int, int): for each prompt, its row of the first kind and its own. The builtin model
    reads attributes alone, such as "fat", as those of the prompt's object, so that two prompts may point away from
    different texts. Raises PromptError, ParameterError: the prior cannot use one of the texts.
    """

    def __init__(self, prior: Prior, prompts: Sequence[WeightedPrompt], negative_prompt: str) -> None:
        self._prompts = prompts
        away: list[Tensor] = []
        texts: list[Tensor] = []
        bases = []
        for each in prompts:
            prompted, unprompted = prior.encode_texts(each.text, negative_prompt)
            known = (number for number, other in enumerate(away) if torch.equal(other, unprompted))
            base = next(known, len(away))
            if base == len(away):
                away.append(unprompted)
            texts.append(prompted)
            bases.append(base)
        self.rows = torch.stack([*away, *texts])
        self.pairs = [(base, len(away) + number) for number, base in enumerate(bases)]

    def grouped(self, values: Sequence[Tensor]) -> list[Tensor]:
        """Return, for each group, the sum of its prompts' values with their weights."""
        terms: list[Tensor] = []
        for each, value in zip(self._prompts, values, strict=True):
            weighted = each.weight * value
            if each.group < len(terms):
                terms[each.group] = terms[each.group] + weighted
            else:
                terms.append(weighted)
        return terms


class Timesteps(NamedTuple):
    """Lowest timestep drawn, and the highest at the first and at the last step, as fractions of T."""

    low: float = 0.02
    high: float = 0.98
    high_end: float = 0.98


_USUAL = Timesteps()


class ScoreDistillation:
    """Guides the views towards the prompt with a diffusion prior.

    Parameters
    ----------
    prompt : str, or sequence of WeightedPrompt
        Encoded once, here, like the negative prompt; a job creates one such object.
    guidance_scale : float
        s.
    guidance_rescale : float in 0 .. 1
        phi.
    timesteps : Timesteps
        Between which each is drawn.
    shading : Shading, optional
        Shading of the views; by default that of the prior's style.

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use this text, or the timestep bounds do not satisfy 0 <= min <= max <= 1 throughout.
    """

    def __init__(
        self,
        prior: Prior,
        prompt: str | Sequence[WeightedPrompt],
        *,
        negative_prompt: str = "",
        guidance_scale: float,
        guidance_rescale: float = 0.0,
        timesteps: Timesteps = _USUAL,
        shading: Shading | None = None,
    ) -> None:
        low = timesteps.low
        for name, high in (("timestep_max", timesteps.high), ("timestep_max_end", timesteps.high_end)):
            if not 0 <= low <= high <= 1:
                raise ParameterError(f"Timesteps must satisfy 0 <= timestep_min ({low}) <= {name} ({high}) <= 1.")
        self._prior = prior
        self._shading = shading
        prompts = [WeightedPrompt(prompt)] if isinstance(prompt, str) else prompt
        self._texts = Texts(prior, prompts, negative_prompt)
        self._scale, self._rescale = guidance_scale, guidance_rescale
        self._low, self._high = low, (timesteps.high, timesteps.high_end)

    @property
    def style(self) -> RenderStyle:
        """Style of the views that the prior requires, with the chosen shading."""
        style = self._prior.style
        return replace(style, shading=self._shading) if self._shading else style

    @property
    def identity(self) -> dict[str, str]:
        """Identity of the prior."""
        return self._prior.identity

    is_heavy = True
    """Torch's threads share the prior's operations."""

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Draw a timestep and noise, predict the noise, and return the loss with the gradient on z0.

        Parameters
        ----------
        image : (1, 3, S, S) or (B, 3, S, S) float32 in [0, 1]
            The grid of four views, or one picture per camera; each picture has its own noise and timestep.

        Returns
        -------
        ``k (1 - abar_t) / 2 ||eps_hat - eps||^2``, the weighted denoising error, whose gradient with respect to z0 is
        defined as above; and for the log `sds_mse`, the mean of ``(eps_hat - eps)^2``, `sds_gradient_norm`, the norm of
        the gradient on z0, and `timestep`. The error depends as much on t as on progress: compare averages.

        Raises
        ------
        NumericalError
            The prediction or z0 is not finite for any of several draws of timestep and noise.
        """
        terms, logs = self.losses(image, context)
        return (terms[0] if len(terms) == 1 else torch.stack(terms).sum()), logs

    def losses(self, image: Tensor, context: StepContext) -> tuple[list[Tensor], dict[str, float]]:
        """Return one loss for each group of prompts; `loss` is their sum, and has the same parameters and errors."""
        z0 = self._prior.encode_image(image)
        for _ in range(_DRAWS):
            terms, logs = self._evaluate(z0.detach(), context)
            if math.isfinite(sum(value.item() for value, _ in terms)) and math.isfinite(logs["sds_gradient_norm"]):
                apply = _StraightThrough.apply
                return [apply(z0, value, gradient) for value, gradient in terms], logs  # type: ignore[no-untyped-call]
        raise NumericalError(
            f"The diffusion prior's prediction at timestep {logs['timestep']:.0f} is not finite in {_DRAWS} draws of "
            "timestep and noise.",
            advice="Set MESHDEFORM_DTYPE=float32, or lower guidance_scale.",
        )

    @torch.no_grad()
    def _evaluate(self, z0: Tensor, context: StepContext) -> tuple[list[tuple[Tensor, Tensor]], dict[str, float]]:
        """Draw a timestep and noise; return each group's loss and gradient on z0, and the numbers for the log."""
        timestep = self._draw_timestep(len(z0), context)
        level = self._prior.alphas_cumprod[timestep].view(-1, 1, 1, 1).to(z0)
        weight = (1 - level) * (REFERENCE_ELEMENTS / z0.numel())
        terms, squares = [], []
        for residual in self._residuals(z0, timestep, level, context):
            gradient = weight * residual
            terms.append((0.5 * (gradient * residual).sum(), gradient))
            squares.append(residual.square().mean())
        whole = terms[0][1] if len(terms) == 1 else torch.stack([gradient for _, gradient in terms]).sum(0)
        mean_square, norm = torch.stack([torch.stack(squares).mean(), whole.norm()]).tolist()
        mean_timestep = timestep.double().mean().item()
        return terms, {"sds_mse": mean_square, "sds_gradient_norm": norm, "timestep": mean_timestep}

    def timestep_bounds(self, context: StepContext) -> tuple[int, int]:
        """Return the lowest and highest timestep that may be drawn at this step, both inclusive."""
        count = self._prior.num_timesteps
        begin, end = self._high
        high = begin + (end - begin) * context.fraction
        lowest = min(round(self._low * count), count - 1)
        return lowest, max(lowest, min(round(high * count), count - 1))

    def _draw_timestep(self, count: int, context: StepContext) -> Tensor:
        """Draw a timestep for each of `count` pictures."""
        low, high = self.timestep_bounds(context)
        return torch.randint(low, high + 1, (count,), generator=context.generator)

    def _residuals(self, z0: Tensor, timestep: Tensor, level: Tensor, context: StepContext) -> list[Tensor]:
        """Return ``eps_hat - eps`` of each group for newly drawn noise; `level` is abar_t of each picture."""
        noise = torch.randn(z0.shape, generator=context.generator, dtype=torch.float32).to(z0.device)
        noisy = level.sqrt() * z0 + (1 - level).sqrt() * noise
        rows = self._texts.rows
        predictions = self._prior.predict_noise(noisy, timestep.to(z0.device), rows, context.cameras)
        guided = []
        for base, text in self._texts.pairs:
            predicted = predictions[base] + self._scale * (predictions[text] - predictions[base])
            if self._rescale:
                predicted = rescaled(predicted, predictions[text], noisy, level, self._rescale)
            guided.append(predicted - noise)
        return self._texts.grouped(guided)


def rescaled(predicted: Tensor, text: Tensor, noisy: Tensor, level: Tensor, phi: float) -> Tensor:
    """Rescale predicted noise so that its clean picture has the spread of the prompted one, mixed by `phi`.

    Parameters
    ----------
    predicted, text, noisy : (B, C, H, W) float32
        eps_hat after guidance, eps_hat of the prompt alone, and z_t.
    level : (B, 1, 1, 1) float32
        abar_t.
    phi : float in 0 .. 1
        0 changes nothing; 1 gives the spread of the prompted picture.

    Returns
    -------
    (B, C, H, W) float32. Source: Lin et al. 2024, eq. 15 and 16, on x0.
    """
    signal, sigma = level.sqrt(), (1 - level).sqrt()
    clean, prompted = (noisy - sigma * predicted) / signal, (noisy - sigma * text) / signal
    spread, target = clean.std((1, 2, 3), keepdim=True), prompted.std((1, 2, 3), keepdim=True)
    clean = clean * (phi * target / spread.clamp_min(1e-8) + 1 - phi)
    return (noisy - signal * clean) / sigma


class _StraightThrough(torch.autograd.Function):
    """Scalar with a given value and a given gradient with respect to z0."""

    @staticmethod
    def forward(ctx: Any, z0: Tensor, value: Tensor, gradient: Tensor) -> Tensor:  # noqa: ARG004
        ctx.save_for_backward(gradient)
        return value.clone()

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return upstream * gradient, None, None
