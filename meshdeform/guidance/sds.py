"""Score distillation: a diffusion model's denoising direction as a gradient on the rendered views.

::

    z_t       = sqrt(abar_t) z0 + sqrt(1 - abar_t) eps        t ~ U(low(step) T, high(step) T),  eps ~ N(0, I)
    eps_hat   = eps(z_t; nothing) + s (eps(z_t; prompt) - eps(z_t; nothing))
    d loss/dz0 = k (1 - abar_t) (eps_hat - eps)               k = 16384 / (number of elements of z0)

The gradient goes straight onto z0; the network itself is never differentiated. The bounds of t move linearly over the
run, from `timestep_min` and `timestep_max` to `timestep_min_end` and `timestep_max_end`.

A model with more latents gives a longer gradient for the same picture: the sum over the elements of z0 grows with
their number, and with it the pull on the mesh against the regularisers. k takes that out. It is 1 for the 4 x 64 x 64
latents of Stable Diffusion at 512 pixels, where the published weights hold, and 1/3 for a model on 3 x 128 x 128
pixels, so `guidance_weight` means the same for every prior. Views that are pictures of their own share the weight.

What differs from the paper where it is asked for, each with its equations where it is named:

* `guidance_rescale` phi brings the spread of the picture that a large s asks for back (`residuals.rescaled`).
* A negative prompt takes the place of nothing, or is kept away from as far as it says nothing about the prompt
  (`texts`, `residuals.perpendicular`): ``eps_hat = eps(nothing) + s (e_text - sum w_i e_i_perp)``.
* `distillation` replaces the residual ``eps_hat - eps``:

  ======  ===================================================================================================
  `csd`   ``s (eps(z_t; prompt) - eps(z_t; nothing))``: the direction of the prompt alone, without the noise,
          which only averages out, and without the unconditional pull
  `nfsd`  ``delta_D + s delta_C``: as csd, with the way to the domain of pictures (`residuals.noise_free`)
  `ism`   ``eps_hat(z_t) - eps(z_s; nothing)``, s = t - interval: z_s by DDIM inversion of the views (`inversion`),
          z_t by one step more. The noise of the pseudo ground truth is the same at both ends, so nothing of it pulls
  ======  ===================================================================================================

Sources: Poole et al. 2023, DreamFusion, eq. 3 (gradient); Xu et al. 2024, FusionDeformer (weighting 1 - abar_t);
Ho & Salimans 2022, eq. 6, in diffusers' convention of s; Lin et al. 2024, Common diffusion noise schedules, eq. 15 and
16 (rescaling); Yu et al. 2024, Text-to-3D with classifier score distillation, eq. 7; Katzir et al. 2023, Noise-free
score distillation; Liang et al. 2024, LucidDreamer, section 3.2 (interval score matching, here weighted 1 - abar_t).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from meshdeform.errors import NumericalError, ParameterError
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.inversion import ddim_step, invert
from meshdeform.guidance.residuals import NOISE_FREE_BOUND, noise_free, perpendicular, rescaled
from meshdeform.guidance.texts import Texts, Told
from meshdeform.requests.choices import Distillation, NegativePrompt

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior
    from meshdeform.rendering.shading import RenderStyle

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
    guidance_rescale : float in 0 .. 1
        phi.
    negative : NegativePrompt
    negative_weight : float
        w of `perpendicular`.
    view_prompts : bool
        Tell each picture where its camera stands; for pictures of one view each.
    distillation : Distillation
    ism_interval, ism_stride : float
        Interval and stride of `ism`, as fractions of T.
    timestep_min, timestep_min_end : float
        Lowest timestep drawn at the first and at the last step, as fractions of T; the same unless the second is given.
    timestep_max, timestep_max_end : float
        Highest timestep drawn at the first and at the last step, as fractions of T.
    noise_draws : int
        How many pairs of timestep and noise a step asks the prior about, for the same pictures; their mean counts.

    Raises
    ------
    PromptError, ParameterError
        The prior cannot use this text, there is no negative text to keep away from, or the timestep bounds are not
        0 <= min <= max <= 1 all along.
    """

    def __init__(
        self,
        prior: Prior,
        prompt: str,
        *,
        negative_prompt: str = "",
        guidance_scale: float,
        guidance_rescale: float = 0.0,
        negative: NegativePrompt = NegativePrompt.UNCONDITIONAL,
        negative_weight: float = 1.0,
        view_prompts: bool = False,
        distillation: Distillation = Distillation.SDS,
        ism_interval: float = 0.05,
        ism_stride: float = 0.2,
        timestep_min: float = 0.02,
        timestep_min_end: float | None = None,
        timestep_max: float = 0.98,
        timestep_max_end: float = 0.98,
        noise_draws: int = 1,
    ) -> None:
        low_end = timestep_min if timestep_min_end is None else timestep_min_end
        for name, low, high in (("", timestep_min, timestep_max), ("_end", low_end, timestep_max_end)):
            if not 0 <= low <= high <= 1:
                raise ParameterError(
                    f"Timesteps must have 0 <= timestep_min{name} ({low}) <= timestep_max{name} ({high}) <= 1."
                )
        self._prior = prior
        self._texts = Texts(
            prior,
            prompt,
            negative_prompt=negative_prompt,
            negative=negative,
            negative_weight=negative_weight,
            view_prompts=view_prompts,
            distillation=distillation,
        )
        self._interval = round(ism_interval * prior.num_timesteps)
        self._stride = max(round(ism_stride * prior.num_timesteps), 1)
        self._scale, self._rescale, self._kind = guidance_scale, guidance_rescale, distillation
        self._low, self._high = (timestep_min, low_end), (timestep_max, timestep_max_end)
        self._draws = noise_draws

    @property
    def style(self) -> RenderStyle:
        """How the prior wants the views drawn."""
        return self._prior.style

    @property
    def single_style(self) -> RenderStyle:
        """How the prior wants a view drawn that is a picture of its own."""
        return self._prior.single_style

    @property
    def identity(self) -> dict[str, str]:
        """The prior's."""
        return self._prior.identity

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Draw a timestep and noise, ask the prior, and put its direction onto z0.

        Parameters
        ----------
        image : (1, 3, S, S) or (B, 3, S, S) float32 in [0, 1]
            The grid of four views, or one picture a camera; each picture has a timestep and noise of its own.
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
        z0 = self._prior.encode_image(image, context.generator)
        with torch.no_grad():
            asked = [self._ask(z0.detach(), context) for _ in range(self._draws)]
            gradient, value, error, timestep = (sum(part) / self._draws for part in zip(*asked, strict=True))
            norm = gradient.norm()
        if not (torch.isfinite(value) and torch.isfinite(norm)):
            raise NumericalError(
                f"The diffusion prior's prediction at timestep {float(timestep):.0f} is not finite.",
                advice="Lower guidance_scale; with a half-precision model, run it in float32.",
            )
        scalar: Tensor = _StraightThrough.apply(z0, value, gradient)  # type: ignore[no-untyped-call]
        return scalar, {"sds_mse": error.item(), "sds_gradient_norm": norm.item(), "timestep": float(timestep)}

    @torch.no_grad()
    def grade(self, image: Tensor, context: StepContext) -> float:
        """How much farther from the pictures is what the prior makes of them by the prompt than without one.

        ``mean (x0_hat(z_t; prompt) - z0)^2 - (x0_hat(z_t; nothing) - z0)^2``, for one timestep between the bounds of
        the step and one noise. What makes any picture hard to predict, its detail say, falls out. Differences of clean
        pictures, and not of noise as in the source: with those the low timesteps of the range decide alone, and the
        grade says less (docs/quality_schedules.md). Source: Li et al. 2023, Your diffusion model is secretly a
        zero-shot classifier, section 3.2 and eq. 9.
        """
        z0 = self._prior.encode_image(image, context.generator)
        low, high = self.timestep_bounds(context)
        timestep = torch.randint(low, high + 1, (len(z0),), generator=context.generator)
        noise = torch.randn(z0.shape, generator=context.generator, dtype=torch.float32).to(z0.device)
        level = self._level(timestep, z0)
        noisy = level.sqrt() * z0 + (1 - level).sqrt() * noise
        base, text, *_ = self._predict(noisy, timestep, self._texts.told(context.cameras).embedding[:2], context)
        excess = (text - noise).square() - (base - noise).square()
        return float((excess * (1 - level) / level).mean())

    def timestep_bounds(self, context: StepContext) -> tuple[int, int]:
        """Lowest and highest timestep that may be drawn at this step, both inclusive."""
        count = self._prior.num_timesteps
        low, high = (begin + (end - begin) * context.fraction for begin, end in (self._low, self._high))
        lowest = min(round(low * count), count - 1)
        return lowest, max(lowest, min(round(high * count), count - 1))

    def _ask(self, z0: Tensor, context: StepContext) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The gradient on z0 of one draw, the loss, the mean squared residual and the mean timestep."""
        generator = context.generator
        low, high = self.timestep_bounds(context)
        timestep = torch.randint(low, high + 1, (len(z0),), generator=generator)
        noise = torch.randn(z0.shape, generator=generator, dtype=torch.float32).to(z0.device)
        told = self._texts.told(context.cameras)
        residual = (
            self._interval_residual(z0, noise, timestep, told, context)
            if self._kind is Distillation.ISM
            else self._residual(z0, noise, timestep, told, context)
        )
        level = self._level(timestep, z0)
        gradient = (1 - level) * (REFERENCE_ELEMENTS / z0.numel()) * residual
        return gradient, 0.5 * (gradient * residual).sum(), residual.square().mean(), timestep.double().mean()

    def _residual(self, z0: Tensor, noise: Tensor, timestep: Tensor, told: Told, context: StepContext) -> Tensor:
        """What takes the place of ``eps_hat - eps``, of drawn noise."""
        level = self._level(timestep, z0)
        noisy = level.sqrt() * z0 + (1 - level).sqrt() * noise
        early = (timestep < NOISE_FREE_BOUND * self._prior.num_timesteps).to(z0.device)
        embedding = told.embedding
        if self._kind is Distillation.NFSD and bool(early.all()):
            embedding = embedding[:2]  # the third text is of no use there
        base, text, *others = self._predict(noisy, timestep, embedding, context)
        direction = self._direction(base, text, others, told)
        if self._kind is Distillation.CSD:
            return self._scale * direction
        if self._kind is Distillation.NFSD:
            # Without a text for bad pictures, nothing stands for them: the two predictions cancel.
            bad = others[0] if others else None if bool(early.all()) else base
            return noise_free(base, bad, direction, self._scale, early)
        return self._guided(base, text, direction, noisy, level) - noise

    def _interval_residual(
        self, z0: Tensor, noise: Tensor, timestep: Tensor, told: Told, context: StepContext
    ) -> Tensor:
        """What takes the place of ``eps_hat - eps``, of noise that the prior itself finds at the interval's begin."""
        begin = (timestep - self._interval).clamp_min(0)

        def nothing(latents: Tensor, at: Tensor) -> Tensor:
            return self._predict(latents, at, told.embedding[:1], context)[0]

        levels = self._prior.alphas_cumprod
        noisy = invert(z0, noise, begin, stride=self._stride, alphas_cumprod=levels, predict=nothing)
        found = nothing(noisy, begin)
        level = self._level(timestep, z0)
        noisy = ddim_step(noisy, found, self._level(begin, z0), level)
        base, text, *others = self._predict(noisy, timestep, told.embedding, context)
        return self._guided(base, text, self._direction(base, text, others, told), noisy, level) - found

    def _predict(self, noisy: Tensor, timestep: Tensor, embedding: Tensor, context: StepContext) -> tuple[Tensor, ...]:
        return self._prior.predict_noise(noisy, timestep.to(noisy.device), embedding, context.cameras)

    def _level(self, timestep: Tensor, z0: Tensor) -> Tensor:
        """abar_t of each picture, (B, 1, 1, 1)."""
        return self._prior.alphas_cumprod[timestep].view(-1, 1, 1, 1).to(z0)

    def _direction(self, base: Tensor, text: Tensor, others: list[Tensor], told: Told) -> Tensor:
        """Where the prompt leads, and not where the texts lead that are kept away from."""
        direction = text - base
        if self._kind is Distillation.NFSD:
            return direction
        away = [
            weight.view(-1, 1, 1, 1).to(base) * perpendicular(other - base, direction)
            for other, weight in zip(others, told.weights, strict=True)
        ]
        return direction - torch.stack(away).sum(0) if away else direction

    def _guided(self, base: Tensor, text: Tensor, direction: Tensor, noisy: Tensor, level: Tensor) -> Tensor:
        """eps_hat: the base, the direction s times, and the spread brought back."""
        predicted = base + self._scale * direction
        return rescaled(predicted, text, noisy, level, self._rescale) if self._rescale else predicted


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
