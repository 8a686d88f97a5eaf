"""Tell in which precision a processor computes fastest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

__all__ = ["is_fast_in_bfloat16"]


def is_fast_in_bfloat16(device: str | torch.device) -> bool:
    """Return whether a device multiplies whole matrices in bfloat16: a GPU from Ampere on, a CPU with `amx_bf16`.

    Other CPUs compute faster in float32, also those with `avx512_bf16`, which multiplies vectors: on one of them a pass
    of the builtin prior and a step of its training took 1.4 to 1.5 times the CPU time of float32. Before torch 2.9 the
    instructions of a CPU are not known.
    """
    if torch.device(device).type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    features: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(features.get("amx_bf16"))
