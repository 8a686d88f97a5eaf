"""Define the interface of a text-to-image diffusion model for score distillation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from torch import Tensor

if TYPE_CHECKING:
    import torch

    from meshdeform.rendering.cameras import Cameras
    from meshdeform.rendering.shading import RenderStyle


class Prior(Protocol):
    """A diffusion model: loaded once in a worker, used by many jobs."""

    @property
    def style(self) -> RenderStyle:
        """Required style of the views."""

    @property
    def num_timesteps(self) -> int:
        """Number of timesteps, T."""

    @property
    def alphas_cumprod(self) -> Tensor:
        """abar_t, the signal's share of the variance of z_t: (T,) float32 on the model's device."""

    @property
    def dtype(self) -> torch.dtype:
        """Return the precision of the model, for the report."""

    @property
    def identity(self) -> dict[str, str]:
        """`id`, `revision` and `sha256`, for the report."""

    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        """Encode the texts of a job as rows for `predict_noise`; called once per job.

        Parameters
        ----------
        others : str
            Negative prompts; an empty one is the unconditional text.

        Returns
        -------
        (1 + len(others), ...) on the model's device; the prompt's row is first.

        Raises
        ------
        PromptError, ParameterError
            The model cannot use one of the texts.
        """

    def encode_image(self, image: Tensor) -> Tensor:
        """Encode a picture, differentiably.

        Parameters
        ----------
        image : (B, 3, S, S) float32 in [0, 1]

        Returns
        -------
        (B, C, H, W) float32 on the model's device: the latents, or the picture in [-1, 1] for a model on pixels.
        """

    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        """Predict eps once for each row of `embedding`; never differentiated.

        Parameters
        ----------
        z_t : (B, C, H, W) float32
            One grid of four views, or B single views.
        timestep : (B,) int64 in 0 .. T - 1
        embedding : (N, ...)
            Rows of `encode_texts`.
        cameras : Cameras
            The cameras of the grid's four views, or one per picture, for models that are conditioned on them.

        Returns
        -------
        N predictions (B, C, H, W) float32, one per text.
        """
