"""Measure what a network knows: its loss on held-out pictures, and which noun it takes a picture for.

::

    noun(x) = argmin over nouns of  mean over draws of ||x0_hat(z_t; noun) - x||^2

Noise and timestep of a draw are the same for all nouns.

Source: Li et al. 2023, Your diffusion model is secretly a zero-shot classifier, eq. 9.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from meshdeform.priors.builtin.grammar import ParsedPrompt, Words, tokenise
from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, add_noise, cosine_alphas_cumprod, loss_weight
from meshdeform.priors.builtin.teaching.picture_set import PictureSet

_LOSS_FRACTIONS = (0.35, 0.6, 0.8, 0.93)
_CLASS_FRACTIONS = (0.86,)
"""Timesteps of the draws, as fractions of T. At lower noise every noun predicts the picture that is still visible."""
_BATCH = 24


@torch.no_grad()
def held_out_loss(network: PriorNetwork, pictures: PictureSet, seed: int = 0) -> float:
    """Return the loss of the training on held-out pictures, with fixed noise at four timesteps."""
    device = network.place.device
    levels = cosine_alphas_cumprod().to(device)
    generator = torch.Generator().manual_seed(seed)
    total, count = 0.0, 0
    for rows in torch.split(torch.arange(len(pictures)), _BATCH):
        clean = pictures.images[rows].to(device).float() / 127.5 - 1.0
        text = network.text(pictures.tokens[rows].to(device))
        for fraction in _LOSS_FRACTIONS:
            timestep = torch.full((len(rows),), round(fraction * (NUM_TIMESTEPS - 1)), device=device)
            noise = torch.randn(clean.shape, generator=generator).to(device)
            noisy = add_noise(clean, noise, timestep, levels).contiguous(memory_format=torch.channels_last)
            azimuth, single = pictures.azimuth_deg[rows].to(device), pictures.single[rows].to(device)
            error = (network(noisy, timestep, text, azimuth, single) - clean).square()
            total += float((loss_weight(timestep, levels) * error).mean()) * len(rows)
            count += len(rows)
    return total / count


@torch.no_grad()
def retrieved(
    network: PriorNetwork,
    words: Words,
    pictures: PictureSet,
    candidates: Sequence[str],
    seed: int = 0,
) -> list[str]:
    """Return the noun that the network takes each picture for.

    Parameters
    ----------
    pictures : PictureSet
        Their labels are not used, except the azimuths.
    """
    device = network.place.device
    levels = cosine_alphas_cumprod().to(device)
    generator = torch.Generator().manual_seed(seed)
    tokens = torch.tensor([tokenise(ParsedPrompt(noun), words) for noun in candidates], device=device)
    texts = network.text(tokens)
    found = []
    for row in range(len(pictures)):
        clean = pictures.images[row : row + 1].to(device).float() / 127.5 - 1.0
        errors = torch.zeros(len(candidates), device=device)
        for fraction in _CLASS_FRACTIONS:
            timestep = torch.full((1,), round(fraction * (NUM_TIMESTEPS - 1)), device=device)
            noise = torch.randn(clean.shape, generator=generator).to(device)
            noisy = add_noise(clean, noise, timestep, levels)
            for some in torch.split(torch.arange(len(candidates), device=device), _BATCH):
                inputs = noisy.expand(len(some), -1, -1, -1).contiguous(memory_format=torch.channels_last)
                azimuth = pictures.azimuth_deg[row].to(device).expand(len(some))
                single = pictures.single[row].to(device).expand(len(some))
                predicted = network(inputs, timestep.expand(len(some)), texts[some], azimuth, single)
                errors[some] += (predicted - clean).square().mean((1, 2, 3))
        found.append(candidates[int(errors.argmin())])
    return found


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    z = 1.96
    share = hits / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(0.0, middle - half), min(1.0, middle + half)
