"""Implement the interface of a diffusion prior with the shipped network.

It works on pixels: z0 is the picture itself, scaled to [-1, 1], without an autoencoder. It is conditioned on the
azimuth of the first view, which keeps a giraffe from growing a head on every side. A picture is a 2 x 2 grid of four
views or a single view, depending on the number of cameras.

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
from meshdeform.priors.builtin.taught import words_of
from meshdeform.priors.builtin.weights_file import WEIGHTS, file_sha256, read_network
from meshdeform.rendering.cameras import NUM_VIEWS, Cameras

__all__ = ["BuiltinPrior"]


class BuiltinPrior:
    """The builtin demonstration prior.

    Parameters
    ----------
    device : str or torch.device
        Device of the network.
    dtype : "auto", "float32", "float16" or "bfloat16"
        What the network computes in. `auto` is float32, and so is float16, a precision of other models.
    weights : pathlib.Path
        A file written by `train.py` or by `meshdeform teach`; by default the one in the package.

    Raises
    ------
    ModelError
        The weights are missing, unreadable or of another vocabulary.
    """

    style = STYLE
    """Style of the four views of a grid; a single view has twice that size."""
    num_timesteps = NUM_TIMESTEPS

    def __init__(self, *, device: str | torch.device = "cpu", weights: Path = WEIGHTS, dtype: str = "float32") -> None:
        network, metadata = read_network(weights)
        self.device = torch.device(device)
        self.dtype = torch.bfloat16 if dtype == "bfloat16" else torch.float32
        self._network = network.computing_in(self.dtype).to(self.device)
        self.words = words_of(metadata, weights)
        self.alphas_cumprod = cosine_alphas_cumprod().to(self.device)
        self.identity = {
            "id": "builtin" if weights == WEIGHTS else str(weights),
            "revision": f"{metadata.get('steps', '?')} steps, seed {metadata.get('seed', '?')}",
            "sha256": file_sha256(weights),
        }

    @torch.no_grad()
    def encode_texts(self, prompt: str, *others: str) -> Tensor:
        """Return text vectors (1 + others, E) float32 of the prompt and of each other text; empty ones are allowed.

        The network was trained with prompt dropout, so the empty text has its own vector. A negative prompt replaces
        the empty text in the guidance.

        Raises
        ------
        PromptError, VocabularyError
            A text is outside this prior's grammar, or a negative prompt means the same as the prompt.
        """
        rows = [torch.tensor([tokenise(parse(prompt, self.words), self.words)])]
        for other in others:
            unwanted = parse_negative(other, prompt, self.words) if other.strip() else None
            rows.append(torch.tensor([tokenise(unwanted, self.words)]) if unwanted else null_tokens(1))
        text: Tensor = self._network.text(torch.cat(rows).to(self.device))
        return text

    def encode_image(self, image: Tensor) -> Tensor:
        """Scale pictures (B, 3, 128, 128) from [0, 1] to [-1, 1], differentiably."""
        return image * 2.0 - 1.0

    @torch.no_grad()
    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        """Predict the noise in z_t for each text.

        Parameters
        ----------
        z_t : (B, 3, 128, 128) float32
            One grid of four views, or B single views.
        timestep : (B,) int64
        embedding : (N, E) float32
            Rows of `encode_texts`.
        cameras : Cameras
            Four for a grid, whose first azimuth is used, or one per picture, each with its own azimuth.

        Returns
        -------
        N of (B, 3, 128, 128) float32.

        Raises
        ------
        ShapeError
            The input is neither a grid of four views nor single views with one camera each.
        """
        count, azimuths = z_t.shape[0], cameras.azimuths_deg
        grid = count == 1 and len(azimuths) == NUM_VIEWS
        if not grid and len(azimuths) != count:
            raise ShapeError(
                f"{count} pictures and {len(azimuths)} cameras are neither a grid of {NUM_VIEWS} views nor single views"
            )
        noisy = z_t.detach().to(self.device, torch.float32)
        texts = len(embedding)
        inputs = noisy.repeat(texts, 1, 1, 1).contiguous(memory_format=torch.channels_last)
        steps = timestep.to(self.device).repeat(texts)
        azimuth = torch.tensor((azimuths[:1] if grid else azimuths) * texts, device=self.device)
        single = None if grid else torch.ones(texts * count, dtype=torch.bool, device=self.device)
        embeddings = embedding.repeat_interleave(count, 0)
        clean = self._network(inputs, steps, embeddings, azimuth, single)
        return noise_from_clean(clean, inputs, steps, self.alphas_cumprod).chunk(texts)
