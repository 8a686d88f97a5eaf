"""The interface of a text-to-image diffusion model behind score distillation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.cameras import Cameras
    from meshdeform.shading import RenderStyle

__all__ = ["Prior", "guided"]


class Prior(Protocol):
    """A diffusion model: loaded once in a worker, used by many jobs."""

    @property
    def style(self) -> RenderStyle:
        """How views must look."""

    @property
    def single_style(self) -> RenderStyle:
        """How a view must look that is a picture of its own."""

    @property
    def num_timesteps(self) -> int:
        """T."""

    @property
    def alphas_cumprod(self) -> Tensor:
        """(T,) float32 on `device`: abar_t, the signal's share of the variance of z_t."""

    @property
    def identity(self) -> dict[str, str]:
        """`id`, `revision` and `sha256`, for the report."""

    @property
    def device(self) -> torch.device:
        """Where it computes."""

    @property
    def dtype(self) -> torch.dtype:
        """What it computes in; z0 and the predicted noise are float32 all the same."""

    def encode_prompt(self, prompt: str, negative_prompt: str = "") -> Any:
        """Turn text into what `predict_noise` takes; called once a job.

        Raises
        ------
        PromptError, ParameterError
            The model cannot use this text.
        """

    def encode_image(self, image: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Encode a picture, differentiably.

        Parameters
        ----------
        image : (B, 3, S, S) float32 in [0, 1]
        generator : torch.Generator on the CPU, optional
            For models whose encoder is random.

        Returns
        -------
        (B, C, H, W) float32 on `device`: the latents, or the picture in [-1, 1] for a model that works on pixels.
        """

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Any, cameras: Cameras) -> tuple[Tensor, Tensor]:
        """Predict eps twice, without the prompt and with it; never differentiated.

        Parameters
        ----------
        z_t : (B, C, H, W) float32
            One grid of four views, or B single views.
        timestep : (B,) int64 in 0 .. T - 1
        embedding
            From `encode_prompt`.
        cameras : Cameras
            Those of the grid's four views, or one a picture, for models that are conditioned on them.

        Returns
        -------
        uncond, text : (B, C, H, W) float32
            What the negative prompt (or nothing) and what the prompt explains. `guided` combines them.
        """


def guided(uncond: Tensor, text: Tensor, guidance_scale: float) -> Tensor:
    """Classifier-free guidance: ``uncond + s (text - uncond)``. Source: Ho & Salimans 2022, eq. 6, diffusers' s."""
    return uncond + guidance_scale * (text - uncond)
