"""Sample pictures from the builtin prior.

Run ``python -m training.prior.sample "a vase" "a tall vase" -o sheet.png``.

Every prompt has a row of pictures, each a 2 x 2 grid of four views (or, with `--single`, one view), sampled with
DDIM (by default deterministic) and classifier-free guidance. Without prompts, every noun has one row.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from meshdeform.priors.builtin.network import WEIGHTS, read_network
from meshdeform.priors.builtin.teaching.sheet import contact_sheet, sample
from meshdeform.priors.builtin.vocabulary import NOUNS


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
