"""Measure whether the prior tells front from back: ``python -m bench.orientation [--timestep N] [--members N]``.

Computes its squared error of the clean picture at a noisy timestep, where it depends on prompt and azimuth alone, with
the true azimuth and with others, on members of the families that it has not seen. Prints ratios to the true azimuth.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

from meshdeform.priors.builtin.grammar import ParsedPrompt
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer, combine_views
from training.prior.families import member

TURNS = (0.0, 90.0, 180.0, 270.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--timestep", type=int, default=960)
    parser.add_argument("--members", type=int, default=3, help="members per noun")
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    prior = BuiltinPrior()
    at = torch.tensor([arguments.timestep])
    level = prior.alphas_cumprod[at].view(1, 1, 1, 1)
    errors = {noun: np.zeros(len(TURNS)) for noun in NOUNS}
    for kind, noun in enumerate(NOUNS):
        embedding = prior.encode_texts(str(ParsedPrompt(noun)))
        for number in range(arguments.members):
            rng = np.random.default_rng([77, kind, number])
            shape = member(noun, (), rng)
            renderer = Renderer(torch.from_numpy(shape.faces), len(shape.verts), prior.style)
            azimuth = float(rng.uniform(-180, 180))
            drawn = renderer.render(torch.from_numpy(shape.verts), fixed_cameras(azimuth, 15.0))
            clean = prior.encode_image(combine_views(drawn))
            noise = torch.randn(clean.shape, generator=torch.Generator().manual_seed(number))
            noisy = level.sqrt() * clean + (1 - level).sqrt() * noise
            for turn, degrees in enumerate(TURNS):
                (text,) = prior.predict_noise(noisy, at, embedding, fixed_cameras(azimuth + degrees, 15.0))
                guessed = (noisy - (1 - level).sqrt() * text) / level.sqrt()
                errors[noun][turn] += float((guessed - clean).square().mean())
    total = np.sum(list(errors.values()), 0)
    print("all nouns  " + "  ".join(f"{t:3.0f} deg {e / total[0]:.2f}" for t, e in zip(TURNS, total, strict=True)))
    worst = sorted(NOUNS, key=lambda noun: -errors[noun][2] / errors[noun][0])
    for noun in worst[:12]:
        ratios = errors[noun] / errors[noun][0]
        print(f"{noun:10s} " + "  ".join(f"{t:3.0f} deg {r:.2f}" for t, r in zip(TURNS, ratios, strict=True)))


if __name__ == "__main__":
    main()
