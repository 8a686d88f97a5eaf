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

from meshdeform.errors import ShapeError
from meshdeform.priors.builtin.grammar import parse, parse_negative, tokenise
from meshdeform.priors.builtin.network import null_tokens
from meshdeform.priors.builtin.schedule import NUM_TIMESTEPS, cosine_alphas_cumprod, noise_from_clean
from meshdeform.priors.builtin.style import STYLE
from meshdeform.priors.builtin.weights_file import WEIGHTS, file_sha256, read_network
from meshdeform.rendering.cameras import NUM_VIEWS, Cameras

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
    """Of the four views of a grid; a view by itself is drawn at twice that size."""
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
    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        """Text vectors (1 + others, E) float32: of the prompt, and of each other text, an empty one saying nothing.

        The network was trained with prompts dropped, so nothing has a vector of its own, and any two prompts can be
        told apart the way that guidance tells a prompt from nothing: that is what a negative prompt does here.

        Raises
        ------
        PromptError, VocabularyError
            A text is not one of this prior's, or a negative prompt says what the prompt says.
        """
        rows = [torch.tensor([tokenise(parse(prompt))])]
        rows += [torch.tensor([tokenise(parse_negative(o, prompt))]) if o.strip() else null_tokens(1) for o in others]
        text: Tensor = self._network.text(torch.cat(rows).to(self.device))
        return text

    def encode_image(self, image: Tensor) -> Tensor:
        """Scale pictures (B, 3, 128, 128) from [0, 1] to [-1, 1]; differentiable, and nothing random."""
        return image * 2.0 - 1.0

    @torch.no_grad()
    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        """The noise in z_t, by each text.

        Parameters
        ----------
        z_t : (B, 3, 128, 128) float32
            One grid of four views, or B single views.
        timestep : (B,) int64
        embedding : (N, E) float32
            Rows of `encode_texts`.
        cameras : Cameras
            Four for a grid, of which the first's azimuth is used; or one a picture, each with its own azimuth.

        Returns
        -------
        N of (B, 3, 128, 128) float32.

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
        texts = len(embedding)
        every = noisy.repeat(texts, 1, 1, 1).contiguous(memory_format=torch.channels_last)
        steps = timestep.to(self.device).repeat(texts)
        azimuth = torch.tensor((azimuths[:1] if grid else azimuths) * texts, device=self.device)
        single = None if grid else torch.ones(texts * count, dtype=torch.bool, device=self.device)
        told = embedding.repeat_interleave(count, 0)
        clean = self._network(every, steps, told, azimuth, single)
        return noise_from_clean(clean, every, steps, self.alphas_cumprod).chunk(texts)
