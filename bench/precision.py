"""Measure the builtin prior's network in bfloat16 and in int8: ``python -m bench.precision``.

Prints the CPU time of a pass for two texts, and of a training step's two passes in bfloat16 for a batch of 16, as
ratios to float32, the medians of many taken in turns, and the root mean square difference of the predicted pictures,
which lie in [-1, 1]. Where the prior uses one of them by itself is said in `native_precision.py`.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import torch
from torch import Tensor

from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.builtin.weights_file import WEIGHTS, read_network
from meshdeform.priors.native_precision import is_fast_in_int8

TIMESTEPS = (100, 500, 900)


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
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    names = ["float32", "bfloat16", *(["int8"] if is_fast_in_int8("cpu") else [])]
    priors = {name: BuiltinPrior(dtype=name) for name in names}
    embedding, azimuth = priors["float32"].encode_texts("a mushroom", ""), torch.tensor([20.0, 20.0])
    noise = torch.randn(2, 3, 128, 128, generator=torch.Generator().manual_seed(0))
    noisy = noise.to(memory_format=torch.channels_last)

    @torch.no_grad()
    def predicted(timestep: int, name: str) -> Tensor:
        clean: Tensor = priors[name]._network(noisy, torch.tensor([timestep] * 2), embedding, azimuth)
        return clean

    taken: dict[str, list[float]] = {name: [] for name in priors}
    for _ in range(options.repeats + 2):
        for name, times in taken.items():
            begun = time.process_time()
            predicted(500, name)
            times.append(time.process_time() - begun)
    print(f"by default: {str(BuiltinPrior(dtype='auto').dtype).removeprefix('torch.')}")
    for name in names[1:]:
        ratio = median(taken[name][2:]) / median(taken["float32"][2:])
        print(f"{name}: {ratio:.2f} of the CPU time of a pass in float32")
        for timestep in TIMESTEPS:
            difference = (predicted(timestep, name) - predicted(timestep, "float32")).square().mean().sqrt()
            print(f"{name}, timestep {timestep}: {float(difference):.4f} apart")
    print(f"bfloat16: {_training(max(3, options.repeats // 6)):.2f} of the CPU time of a training step in float32")


if __name__ == "__main__":
    main()
