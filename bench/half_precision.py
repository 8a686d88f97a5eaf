"""Measure the builtin prior's network in bfloat16: ``python -m bench.half_precision``.

Prints CPU times of a pass for two texts as ratios to float32, the smallest of many taken in turns, and the root mean
square difference of the predicted pictures, which lie in [-1, 1]. Useful on a processor with such instructions
(`avx512_bf16` or `amx_bf16`); others compute in float32 and convert.
"""

from __future__ import annotations

import argparse
import time

import torch
from torch import Tensor

from meshdeform.priors.builtin.prior import BuiltinPrior

TIMESTEPS = (100, 500, 900)


def main() -> None:
    """Compare the two precisions."""
    parser = argparse.ArgumentParser(prog="python -m bench.half_precision", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    prior = BuiltinPrior()
    embedding, azimuth = prior.encode_texts("a mushroom", ""), torch.tensor([20.0, 20.0])
    noise = torch.randn(2, 3, 128, 128, generator=torch.Generator().manual_seed(0))
    noisy = noise.to(memory_format=torch.channels_last)

    @torch.no_grad()
    def predicted(timestep: int, *, half: bool) -> Tensor:
        with torch.autocast("cpu", torch.bfloat16, enabled=half):
            return prior._network(noisy, torch.tensor([timestep] * 2), embedding, azimuth).float()

    taken: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(options.repeats + 2):
        for half, times in taken.items():
            begun = time.process_time()
            predicted(500, half=half)
            times.append(time.process_time() - begun)
    print(f"bfloat16 instructions: {'yes' if torch.ops.mkldnn._is_mkldnn_bf16_supported() else 'no'}")
    print(f"CPU time of a pass: {min(taken[True][2:]) / min(taken[False][2:]):.2f} of that in float32")
    for timestep in TIMESTEPS:
        difference = (predicted(timestep, half=True) - predicted(timestep, half=False)).square().mean().sqrt()
        print(f"timestep {timestep}: {float(difference):.4f} apart")


if __name__ == "__main__":
    main()
