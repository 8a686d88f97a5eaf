"""`BuiltinPrior`: the shipped network behind the interface that every diffusion prior has.

It works on pixels: z0 is the picture itself, scaled to [-1, 1], and there is no autoencoder between the mesh
and the gradient. It knows the azimuth of the first view, which is what keeps a giraffe from growing a
head on every side. A picture is a 2 x 2 grid of four views, or one view alone: the cameras say which.

::

    eps_hat = eps(z_t, nothing) + s (eps(z_t, prompt) - eps(z_t, nothing))

Source: Ho & Salimans 2022, Classifier-free diffusion guidance, eq. 6, in diffusers' convention of s.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from meshdeform.cameras import NUM_VIEWS, Cameras
from meshdeform.errors import ParameterError, ShapeError
from meshdeform.priors.builtin.diffusion import NUM_TIMESTEPS, cosine_alphas_cumprod, noise_from_clean
from meshdeform.priors.builtin.grammar import parse, tokenise
from meshdeform.priors.builtin.model import null_tokens
from meshdeform.priors.builtin.style import SINGLE_STYLE, STYLE
from meshdeform.priors.builtin.weights_file import WEIGHTS, file_sha256, read_network

__all__ = ["BuiltinPrior"]


class BuiltinPrior:
    """The builtin demonstration prior.

    Parameters
    ----------
    device : str or torch.device
        Where the network runs. It computes in float32 everywhere.
    weights : pathlib.Path
        A file that `train.py` wrote; the one in the package unless given.

    Raises
    ------
    ModelError
        The weights are missing, unreadable or of another vocabulary.
    """

    style = STYLE
    """Of the four views of a grid."""
    single_style = SINGLE_STYLE
    """Of single views."""
    num_timesteps = NUM_TIMESTEPS

    def __init__(self, *, device: str | torch.device = "cpu", weights: Path = WEIGHTS) -> None:
        network, metadata = read_network(weights)
        self.device = torch.device(device)
        self.dtype = torch.float32
        self._network = network.to(self.device)
        self.alphas_cumprod = cosine_alphas_cumprod().to(self.device)
        self.identity = {
            "id": "builtin",
            "revision": f"{metadata.get('steps', '?')} steps, seed {metadata.get('seed', '?')}",
            "sha256": file_sha256(weights),
        }

    @torch.no_grad()
    def encode_prompt(self, prompt: str, negative_prompt: str = "") -> Tensor:
        """Text vectors (2, E) float32: of nothing, and of the prompt.

        Raises
        ------
        PromptError, VocabularyError
            The prompt is not one of this prior's.
        ParameterError
            There is a negative prompt, which this prior was not trained to use.
        """
        if negative_prompt.strip():
            raise ParameterError(
                "The builtin demonstration prior takes no negative_prompt.",
                advice="Leave negative_prompt out, or choose a Stable Diffusion model.",
            )
        tokens = torch.cat([null_tokens(1), torch.tensor([tokenise(parse(prompt))])])
        text: Tensor = self._network.text(tokens.to(self.device))
        return text

    def encode_image(self, image: Tensor, generator: torch.Generator | None = None) -> Tensor:  # noqa: ARG002
        """Scale pictures (B, 3, 128, 128) from [0, 1] to [-1, 1]; differentiable, and nothing random."""
        return image * 2.0 - 1.0

    @torch.no_grad()
    def predict_noise(
        self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras
    ) -> tuple[Tensor, Tensor]:
        """The noise in z_t, without the prompt and with it.

        Parameters
        ----------
        z_t : (B, 3, 128, 128) float32
            One grid of four views, or B single views.
        timestep : (B,) int64
        embedding : (2, E) float32
            From `encode_prompt`.
        cameras : Cameras
            Four for a grid, of which the first's azimuth is used; or one a picture, each with its own azimuth.

        Returns
        -------
        Two of (B, 3, 128, 128) float32: without the prompt, and with it.

        Raises
        ------
        ShapeError
            Neither a grid nor a camera for every picture.
        """
        count, azimuths = z_t.shape[0], cameras.azimuths_deg
        grid = count == 1 and len(azimuths) == NUM_VIEWS
        if not grid and len(azimuths) != count:
            raise ShapeError(
                f"{count} pictures and {len(azimuths)} cameras are neither a grid of {NUM_VIEWS} views nor single views"
            )
        noisy = z_t.detach().to(self.device, self.dtype)
        both = noisy.repeat(2, 1, 1, 1).contiguous(memory_format=torch.channels_last)
        steps = timestep.to(self.device).repeat(2)
        azimuth = torch.tensor((azimuths[:1] if grid else azimuths) * 2, device=self.device)
        single = None if grid else torch.ones(2 * count, dtype=torch.bool, device=self.device)
        text = embedding.repeat_interleave(count, 0)
        clean = self._network(both, steps, text, azimuth, single)
        nothing, prompted = noise_from_clean(clean, both, steps, self.alphas_cumprod).chunk(2)
        return nothing, prompted
