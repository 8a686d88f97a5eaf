"""The interface of a text-to-image diffusion model behind score distillation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.cameras import Cameras
    from meshdeform.shading import RenderStyle

__all__ = ["Prior"]


class Prior(Protocol):
    """A diffusion model: loaded once in a worker, used by many jobs."""

    @property
    def style(self) -> RenderStyle:
        """How views must look."""

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
        image : (1, 3, S, S) float32 in [0, 1]
        generator : torch.Generator on the CPU, optional
            For models whose encoder is random.

        Returns
        -------
        (1, C, H, W) float32 on `device`: the latents, or the picture in [-1, 1] for a model that works on pixels.
        """

    def predict_noise(
        self, z_t: Tensor, timestep: Tensor, embedding: Any, guidance_scale: float, cameras: Cameras
    ) -> Tensor:
        """Predict eps with classifier-free guidance; never differentiated.

        Parameters
        ----------
        z_t : (1, C, H, W) float32
        timestep : (1,) int64 in 0 .. T - 1
        embedding
            From `encode_prompt`.
        guidance_scale : float
            s in ``uncond + s * (text - uncond)``.
        cameras : Cameras
            The cameras of the four views, for models that are conditioned on them.

        Returns
        -------
        (1, C, H, W) float32
        """
