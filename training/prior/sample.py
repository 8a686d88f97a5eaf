"""Sample pictures from the builtin prior.

Run ``python -m training.prior.sample "a vase" "a tall vase" -o sheet.png``.

Every prompt has a row of pictures, each a 2 x 2 grid of four views (or, with `--single`, one view), sampled with
DDIM and classifier-free guidance. Without prompts, every noun has one row.

Source: Song et al. 2021, Denoising diffusion implicit models, eq. 12 with eta = 0.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw
from torch import Tensor

from meshdeform.priors.builtin.grammar import BUILTIN_WORDS, parse, tokenise
from meshdeform.priors.builtin.network import IMAGE_SIZE, WEIGHTS, PriorNetwork, null_tokens, read_network
from meshdeform.priors.builtin.prior import NUM_TIMESTEPS, cosine_alphas_cumprod, noise_from_clean
from meshdeform.priors.builtin.vocabulary import NOUNS


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
) -> Tensor:
    """Sample pictures of prompts.

    `azimuth_deg`, (B,) float32: azimuth of the first or only view; `steps`: number of evenly spaced evaluations of the
    network; `single`: sample single views instead of grids. Returns (B, 3, 128, 128) float32 in [0, 1].
    """
    count = len(prompts)
    numbers = [tokenise(parse(prompt, BUILTIN_WORDS)) for prompt in prompts]
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
        after = levels[following]
        x = after.sqrt() * clean + (1.0 - after).sqrt() * noise
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


def main() -> None:
    """Draw a contact sheet."""
    parser = argparse.ArgumentParser(prog="python -m training.prior.sample", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("prompts", nargs="*", default=list(NOUNS), help="default: every noun")
    parser.add_argument("-o", "--output", type=Path, default=Path("samples.png"))
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--each", type=int, default=2, help="pictures per prompt")
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--guidance-scale", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--single", action="store_true", help="single views instead of grids")
    arguments = parser.parse_args()
    network, metadata = read_network(arguments.weights)
    turns = torch.linspace(30.0, 150.0, arguments.each) if arguments.each > 1 else torch.tensor([30.0])
    rows = [
        sample(
            network,
            [prompt] * arguments.each,
            turns,
            steps=arguments.steps,
            guidance_scale=arguments.guidance_scale,
            seed=arguments.seed,
            single=arguments.single,
        )
        for prompt in arguments.prompts
    ]
    contact_sheet(rows, arguments.prompts, columns=max(1, min(4, len(rows) // 6))).save(arguments.output)
    print(f"{arguments.output}: {len(rows)} prompts, weights of {metadata.get('steps', '?')} steps")


if __name__ == "__main__":
    main()
