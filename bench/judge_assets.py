"""Ask the judge what real assets are: ``python bench/judge_assets.py FILE[=NOUN,NOUN...] ... [--picture FILE]``.

Prints for each asset the judge's three likeliest nouns, and for one with nouns (what a person would call it) the best
rank of them. Assets that nobody made for this project are the check on members that its own code draws. With
`--picture`, the eight views that the judge sees of each asset are written, one row each.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from meshdeform.judge import WEIGHTS, Judge
from meshdeform.judge.scoring import draw_views, judging_cameras
from training.evaluation.sources import source_mesh


def main() -> None:
    """Print a row for each asset, and the shares of those that are right."""
    parser = argparse.ArgumentParser(prog="python bench/judge_assets.py", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("assets", nargs="+", help="a file, and after = what it shows")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--picture", type=Path, help="PNG of the judge's views")
    parser.add_argument("--threads", type=int, help="CPU threads")
    arguments = parser.parse_args()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    judge = Judge(arguments.weights)
    ranks, rows = [], []
    for given in arguments.assets:
        name, _, wanted = given.partition("=")
        mesh = source_mesh(name)
        likely = sorted(judge.noun_probabilities(mesh).items(), key=lambda item: -item[1])
        best = ", ".join(f"{noun} {share:.2f}" for noun, share in likely[:3])
        order = [noun for noun, _ in likely]
        rank = min((order.index(noun) + 1 for noun in wanted.split(",")), default=0) if wanted else 0
        print(f"{Path(name).name:<24} {wanted:<16} {rank or '':>4}  {best}")
        ranks += [rank] if rank else []
        rows.append(np.concatenate(list((draw_views(mesh, *judging_cameras())[:, 0] * 255).byte().numpy()), 1))
    if ranks:
        right = [sum(rank <= k for rank in ranks) for k in (1, 3)]
        print(f"of {len(ranks)} with nouns: first {right[0]}, among the first three {right[1]}")
    if arguments.picture:
        Image.fromarray(np.concatenate(rows)).save(arguments.picture)


if __name__ == "__main__":
    main()
