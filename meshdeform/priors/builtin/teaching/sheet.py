"""Sample pictures from a network of the builtin prior, and draw what it has learned of a noun as a contact sheet.

Source: Song et al. 2021, Denoising diffusion implicit models, eqs. 12 and 16 (eta = 1 is the ancestral sampling of
Ho et al. 2020).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import Tensor

from meshdeform.priors.builtin.grammar import BUILTIN_WORDS, Attribute, ParsedPrompt, Words, parse, tokenise
from meshdeform.priors.builtin.network import IMAGE_SIZE, PriorNetwork, null_tokens
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, cosine_alphas_cumprod, noise_from_clean
from meshdeform.priors.builtin.teaching.views import PictureSet

_AZIMUTHS = (0.0, 90.0, 180.0, 270.0)
_STEPS = 24
_SHOWN = ("tall",)


@torch.no_grad()
def sample(
    network: PriorNetwork,
    prompts: Sequence[str],
    azimuth_deg: Tensor,
    *,
    steps: int = 40,
    guidance_scale: float = 3.0,
    seed: int = 0,
    single: bool = False,
    words: Words = BUILTIN_WORDS,
    eta: float = 0.0,
) -> Tensor:
    """Sample pictures of prompts.

    `azimuth_deg`, (B,) float32: azimuth of the first or only view; `steps`: number of evenly spaced evaluations of the
    network; `single`: sample single views instead of grids; `eta`: share of the noise that is drawn anew after every
    step: 0 is deterministic, 1 is ancestral sampling. Returns (B, 3, 128, 128) float32 in [0, 1].
    """
    count = len(prompts)
    numbers = [tokenise(parse(prompt, words), words) for prompt in prompts]
    tokens = torch.cat([torch.tensor(numbers), null_tokens(count)])
    text = network.text(tokens)
    levels = cosine_alphas_cumprod()
    alone = torch.ones(2 * count, dtype=torch.bool) if single else None
    generator = torch.Generator().manual_seed(seed)
    x = torch.randn(count, 3, IMAGE_SIZE, IMAGE_SIZE, generator=generator)
    schedule = torch.linspace(NUM_TIMESTEPS - 1, 0, steps + 1).long()
    for now, following in itertools.pairwise(schedule):
        both = torch.cat([x, x]).contiguous(memory_format=torch.channels_last)
        prompted, nothing = network(both, now.expand(2 * count), text, azimuth_deg.repeat(2), alone).chunk(2)
        # Guidance of x0 is equivalent to guidance of eps, because each is affine in the other.
        clean = (nothing + guidance_scale * (prompted - nothing)).clamp(-1.0, 1.0)
        noise = noise_from_clean(clean, x, now.expand(count), levels)
        level, after = levels[now], levels[following]
        fresh = eta * ((1 - after) / (1 - level) * (1 - level / after)).clamp_min(0.0).sqrt()
        x = after.sqrt() * clean + (1.0 - after - fresh**2).clamp_min(0.0).sqrt() * noise
        if eta:
            x = x + fresh * torch.randn(x.shape, generator=generator)
    return (x.clamp(-1.0, 1.0) + 1.0) / 2.0


def contact_sheet(rows: Sequence[Tensor], labels: Sequence[str], columns: int = 1) -> Image.Image:
    """Arrange rows (N, 3, H, W) of pictures in [0, 1] under their labels, several rows side by side."""
    tiles = []
    for row, label in zip(rows, labels, strict=True):
        strip = torch.cat(list(row), 2).permute(1, 2, 0).mul(255).round().to(torch.uint8).numpy()
        tile = Image.fromarray(np.pad(strip, ((14, 4), (0, 6), (0, 0))))
        ImageDraw.Draw(tile).text((2, 1), label, fill="white")
        tiles.append(tile)
    width, height = tiles[0].size
    sheet = Image.new("RGB", (width * columns, height * -(-len(tiles) // columns)))
    for number, tile in enumerate(tiles):
        sheet.paste(tile, (number % columns * width, number // columns * height))
    return sheet


def learned_sheet(network: PriorNetwork, words: Words, seen: Mapping[str, PictureSet], *, seed: int = 0) -> Image.Image:
    """Draw the nouns that a network has learned, with pictures of the training.

    Of one noun: rows of grids, single views, and single views with an attribute. Of several: a row of each. `network`:
    on the CPU; `seen`: by noun, pictures of the training, of which the first single views are shown.
    """
    if len(seen) > 1:
        return _sheet_of_kit(network, words, seen, seed)
    noun, pictures = next(iter(seen.items()))
    prompts = [ParsedPrompt(noun), *(ParsedPrompt(noun, (Attribute("whole", degree),)) for degree in _SHOWN)]
    plain, *others = map(str, prompts)
    rows = [_training(pictures, 4)]
    labels = ["from the training"]
    for text, single in ((plain, False), (plain, True), *((other, True) for other in others)):
        azimuths = torch.tensor(_AZIMUTHS)
        rows.append(sample(network, [text] * 4, azimuths, steps=_STEPS, seed=seed, single=single, words=words, eta=1.0))
        labels.append(f"{text}, azimuths 0, 90, 180, 270" + ("" if single else ", four views each"))
    return contact_sheet(rows, labels)


def _sheet_of_kit(network: PriorNetwork, words: Words, seen: Mapping[str, PictureSet], seed: int) -> Image.Image:
    """Draw a row of each noun: a single view of the training, and three that the network draws."""
    rows = []
    for noun, pictures in seen.items():
        azimuths = torch.tensor(_AZIMUTHS[:3]) + 30.0
        prompts = [str(ParsedPrompt(noun))] * len(azimuths)
        samples = sample(network, prompts, azimuths, steps=_STEPS, seed=seed, single=True, words=words, eta=1.0)
        rows.append(torch.cat([_training(pictures, 1), samples]))
    return contact_sheet(rows, [f"{noun}: from the training, learned" for noun in seen], columns=2)


def _training(seen: PictureSet, count: int) -> Tensor:
    shown = seen.images[seen.single][:count]
    blank = torch.zeros(count - len(shown), *shown.shape[1:], dtype=shown.dtype)
    return torch.cat([shown, blank]).float() / 255.0
