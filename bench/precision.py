"""Measure the builtin prior's network in bfloat16 and in int8: ``python -m bench.precision``.

Prints the CPU time of a pass for two texts, and of a training step's two passes in bfloat16 for a batch of 16, as
ratios to float32, the medians of many taken in turns, and the root mean square difference of what is predicted, which
lies in [-1, 1], for pictures that the prior made of six prompts, noised to five timesteps. `--nearest` rounds each
weight of int8 to the nearest step. Where the prior uses one of them by itself is said in `precision.py`.
"""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext
from statistics import median
from unittest import mock

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.priors.builtin.network import WEIGHTS, read_network
from meshdeform.priors.builtin.prior import BuiltinPrior, add_noise
from meshdeform.priors.precision import is_fast_in_int8

ROUND = "meshdeform.priors.builtin.quantized.round_weights"
TIMESTEPS = (100, 300, 500, 700, 900)
PROMPTS = ("a mushroom", "a tall giraffe", "a fat teapot", "a motorcycle", "a castle", "a crab")


def _clean(prior: BuiltinPrior, noisy: Tensor, timestep: int, texts: Tensor) -> Tensor:
    """Predict the clean pictures of a prompt and of no prompt, from one picture (1, 3, 128, 128)."""
    both = noisy.repeat(2, 1, 1, 1).contiguous(memory_format=torch.channels_last)
    clean: Tensor = prior._network(both, torch.tensor([timestep] * 2), texts, torch.tensor([20.0, 20.0]))
    return clean


@torch.no_grad()
def _difference(prior: BuiltinPrior, exact: BuiltinPrior) -> float:
    """Return the root mean square difference of predictions."""
    generator = torch.Generator().manual_seed(0)
    squares = []
    for prompt in PROMPTS:
        texts = exact.encode_texts(prompt, "")
        picture = _clean(exact, torch.randn(1, 3, 128, 128, generator=generator), 950, texts)[:1]
        for timestep in TIMESTEPS:
            noise = torch.randn(1, 3, 128, 128, generator=generator)
            noisy = add_noise(picture, noise, torch.tensor([timestep]), exact.alphas_cumprod)
            apart = _clean(prior, noisy, timestep, texts) - _clean(exact, noisy, timestep, texts)
            squares.append(apart.square().mean())
    return float(torch.stack(squares).mean().sqrt())


def _nearest(weights: NDArray[np.float32], largest: int) -> NDArray[np.int8]:
    """Round each weight by itself."""
    return np.clip(np.round(weights), -largest, largest).astype(np.int8)


def _training(repeats: int) -> float:
    """Return the CPU time of a forward and a backward pass with autocast, over that without."""
    network, _ = read_network(WEIGHTS)
    network.train().requires_grad_(requires_grad=True)
    noisy = torch.randn(16, 3, 128, 128, generator=torch.Generator().manual_seed(0))
    noisy = noisy.to(memory_format=torch.channels_last)
    text, azimuth = torch.zeros(16, network.config.embedding), torch.zeros(16)
    taken: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(repeats + 1):
        for half, times in taken.items():
            begun = time.process_time()
            with torch.autocast("cpu", torch.bfloat16, enabled=half):
                clean = network(noisy, torch.full((16,), 900), text, azimuth)
            clean.float().square().mean().backward()
            times.append(time.process_time() - begun)
    return median(taken[True][1:]) / median(taken[False][1:])


def main() -> None:
    """Compare the precisions."""
    parser = argparse.ArgumentParser(prog="python -m bench.precision", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--nearest", action="store_true", help="round each weight of int8 by itself")
    parser.add_argument("--no-training", dest="training", action="store_false", help="leave out the training step")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    names = ["float32", "bfloat16", *(["int8"] if is_fast_in_int8("cpu") else [])]
    with mock.patch(ROUND, _nearest) if options.nearest else nullcontext():
        priors = {name: BuiltinPrior(dtype=name) for name in names}
    exact = priors["float32"]
    texts, noise = exact.encode_texts("a mushroom", ""), torch.randn(1, 3, 128, 128)
    taken: dict[str, list[float]] = {name: [] for name in priors}
    with torch.no_grad():
        for _ in range(options.repeats + 2):
            for name, times in taken.items():
                begun = time.process_time()
                _clean(priors[name], noise, 500, texts)
                times.append(time.process_time() - begun)
    print(f"by default: {str(BuiltinPrior(dtype='auto').dtype).removeprefix('torch.')}")
    for name in names[1:]:
        ratio = median(taken[name][2:]) / median(taken["float32"][2:])
        difference = _difference(priors[name], exact)
        print(f"{name}: {ratio:.2f} of the CPU time of a pass in float32, {difference:.4f} apart")
    if options.training:
        print(f"bfloat16: {_training(max(3, options.repeats // 6)):.2f} of the CPU time of a training step in float32")


if __name__ == "__main__":
    main()
