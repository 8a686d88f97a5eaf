"""What score distillation asks of a text-to-image diffusion model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.cameras import Cameras
    from meshdeform.shading import RenderStyle

__all__ = ["Prior"]


class Prior(Protocol):
    """A diffusion model with its text encoder, on one device."""

    style: RenderStyle
    """How the model wants the views drawn."""

    num_timesteps: int
    """T."""

    alphas_cumprod: Tensor
    """(T,) float32: abar_t."""

    identity: dict[str, str]
    """`id`, `revision` and `sha256` of what was loaded."""

    device: torch.device
    dtype: torch.dtype

    def encode_prompt(self, prompt: str, negative_prompt: str = "") -> Any:
        """Embedding of both branches, opaque to the caller; made once a job.

        Raises
        ------
        PromptError, VocabularyError, ParameterError
            The prompt is not one of this model's.
        """

    def encode_image(self, image: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """z_0 of a picture (1, 3, S, S) in [0, 1]; differentiable. Pixel models scale to [-1, 1], others encode."""

    def predict_noise(
        self, z_t: Tensor, timestep: Tensor, embedding: Any, guidance_scale: float, cameras: Cameras
    ) -> Tensor:
        """eps_hat, shaped as `z_t`, by ``uncond + guidance_scale * (text - uncond)``; no gradient.

        Parameters
        ----------
        z_t : tensor as `encode_image` gives
        timestep : (1,) int64
        embedding
            From `encode_prompt`.
        guidance_scale : float
        cameras : Cameras
            For models that know the view.
        """
