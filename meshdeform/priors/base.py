"""The interface of a text-to-image diffusion model behind score distillation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from torch import Tensor

if TYPE_CHECKING:
    from meshdeform.rendering.cameras import Cameras
    from meshdeform.rendering.shading import RenderStyle

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
        """(T,) float32 where the model computes: abar_t, the signal's share of the variance of z_t."""

    @property
    def identity(self) -> dict[str, str]:
        """`id`, `revision` and `sha256`, for the report."""

    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        """Turn the texts of a job into rows for `predict_noise`; called once a job.

        Parameters
        ----------
        prompt : str
        others : str
            Negative prompts; an empty one says nothing.

        Returns
        -------
        (1 + len(others), ...) where the model computes: the prompt's row first.

        Raises
        ------
        PromptError, ParameterError
            The model cannot use one of them.
        """

    def encode_image(self, image: Tensor) -> Tensor:
        """Encode a picture, differentiably.

        Parameters
        ----------
        image : (B, 3, S, S) float32 in [0, 1]

        Returns
        -------
        (B, C, H, W) float32 where the model computes: the latents, or for a model that works on pixels the picture in
        [-1, 1].
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
            Those of the grid's four views, or one a picture, for models that are conditioned on them.

        Returns
        -------
        N of (B, C, H, W) float32: what each text explains.
        """
