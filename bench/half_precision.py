"""Measure the builtin prior's network in bfloat16: ``python -m bench.half_precision``.

Prints the CPU time of a pass for two texts as a ratio to float32, the median of many taken in turns, and the root mean
square difference of the predicted pictures, which lie in [-1, 1]. With matrix instructions (`amx_bf16`), bfloat16 is
faster; without, it is slower.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import torch
from torch import Tensor

from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.native_precision import is_fast_in_bfloat16

TIMESTEPS = (100, 500, 900)


def main() -> None:
    """Compare the two precisions."""
    parser = argparse.ArgumentParser(prog="python -m bench.half_precision", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    priors = {name: BuiltinPrior(dtype=name) for name in ("float32", "bfloat16")}
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
    print(f"matrix instructions in bfloat16: {'yes' if is_fast_in_bfloat16('cpu') else 'no'}")
    print(f"CPU time of a pass: {median(taken['bfloat16'][2:]) / median(taken['float32'][2:]):.2f} of that in float32")
    for timestep in TIMESTEPS:
        difference = (predicted(timestep, "bfloat16") - predicted(timestep, "float32")).square().mean().sqrt()
        print(f"timestep {timestep}: {float(difference):.4f} apart")


if __name__ == "__main__":
    main()
