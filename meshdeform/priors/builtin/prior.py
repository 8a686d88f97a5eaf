"""Implement the interface of a diffusion prior with the shipped network.

It works on pixels: z0 is the picture itself, scaled to [-1, 1], without an autoencoder. It is conditioned on the
azimuth of the first view, which keeps a giraffe from growing a head on every side. A picture is a 2 x 2 grid of four
views or a single view, depending on the number of cameras.

::

    eps_hat = eps(z_t, nothing) + s (eps(z_t, prompt) - eps(z_t, nothing))

The noise schedule, and the network's prediction of the clean picture as noise::

    x_t     = sqrt(abar) x0 + sqrt(1 - abar) eps
    eps_hat = (x_t - sqrt(abar) x0_hat) / sqrt(1 - abar)
    loss    = min(1 / (1 - abar), 5) |x0_hat - x0|^2

The network predicts x0 rather than eps or v: its stem maps patches of 4 x 4 x 3 numbers to 48 channels, which preserves
the smooth pictures but not noise. With the weight 1 / (1 - abar) = SNR + 1, this is the loss of v; the upper bound
keeps the nearly clean timesteps, where there is little to learn, from dominating.

Sources: Ho & Salimans 2022, Classifier-free diffusion guidance, eq. 6, in diffusers' convention of s; Ho et al. 2020,
eq. 4; Nichol & Dhariwal 2021, eq. 17; Salimans & Ho 2022, section 4 (SNR + 1 weighting); Hang et al. 2023 (bounded
SNR); Li & He 2025, Back to basics (predict x0 where patches are wide).
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.priors.builtin.network import WEIGHTS, null_tokens, read_network
from meshdeform.priors.builtin.vocabulary import BUILTIN_WORDS, tokenise
from meshdeform.rendering.cameras import NUM_VIEWS, Cameras
from meshdeform.rendering.shading import RenderStyle
from meshdeform.support.files import file_sha256
from meshdeform.vocabulary.grammar import parse, parse_negative

NUM_TIMESTEPS = 1000

STYLE = RenderStyle(view_size=64, supersample=2, shading="normals", background=(0.0, 0.0, 0.0))
"""Style of a view in the 2 x 2 grid; four of them fill the picture."""


def cosine_alphas_cumprod() -> Tensor:
    """Return the products of the alphas, (T,) float32: cos^2((t/T + s) / (1 + s) * pi/2) with s = 0.008.

    Source: Nichol & Dhariwal 2021, eq. 17, shifted by one so that no level is exactly 0 or 1.
    """
    at = torch.arange(1, NUM_TIMESTEPS + 1, dtype=torch.float64) / (NUM_TIMESTEPS + 1)
    level = torch.cos((at + 0.008) / 1.008 * math.pi / 2) ** 2
    return level.to(torch.float32)


def noise_from_clean(clean: Tensor, noisy: Tensor, timestep: Tensor, alphas_cumprod: Tensor) -> Tensor:
    """Return eps, given x0 and x_t."""
    level = alphas_cumprod[timestep][:, None, None, None]
    return (noisy - level.sqrt() * clean) / (1.0 - level).sqrt()


class BuiltinPrior:
    """The builtin demonstration prior.

    `dtype`, "auto", "float32", "float16" or "bfloat16": what the network computes in; all but bfloat16 are float32.
    `weights`: a file written by `train.py`; by default the one in the package. Raises
    ModelError: the weights are missing, unreadable or of another vocabulary.
    """

    style = STYLE
    """Style of the four views of a grid; a single view has twice that size."""
    num_timesteps = NUM_TIMESTEPS

    def __init__(self, *, device: str | torch.device = "cpu", weights: Path = WEIGHTS, dtype: str = "float32") -> None:
        network, metadata = read_network(weights)
        self.device = torch.device(device)
        self.dtype = torch.bfloat16 if dtype == "bfloat16" else torch.float32
        self._network = network.computing_in(self.dtype).to(self.device)
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
        the empty text in the guidance. Raises PromptError, VocabularyError: a text is outside this prior's grammar, or
        a negative prompt means the same as the prompt.
        """
        rows = [torch.tensor([tokenise(parse(prompt, BUILTIN_WORDS))])]
        for other in others:
            unwanted = parse_negative(other, prompt, BUILTIN_WORDS) if other.strip() else None
            rows.append(torch.tensor([tokenise(unwanted)]) if unwanted else null_tokens(1))
        text: Tensor = self._network.text(torch.cat(rows).to(self.device))
        return text

    def encode_image(self, image: Tensor) -> Tensor:
        """Scale pictures (B, 3, 128, 128) from [0, 1] to [-1, 1], differentiably."""
        return image * 2.0 - 1.0

    @torch.no_grad()
    def predict_noise(self, z_t: Tensor, timestep: Tensor, embedding: Tensor, cameras: Cameras) -> tuple[Tensor, ...]:
        """Predict the noise in z_t for each text.

        `z_t`, (B, 3, 128, 128) float32: one grid of four views, or B single views; `timestep` is (B,) int64;
        `embedding`, (N, E) float32: rows of `encode_texts`; `cameras`: four for a grid, whose first azimuth is used, or
        one per picture, each with its own azimuth. Returns n of (B, 3, 128, 128) float32. Raises ShapeError: the input
        is neither a grid of four views nor single views with one camera each.
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
