"""Tell in which precision a processor computes fastest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

__all__ = ["is_fast_in_bfloat16"]


def is_fast_in_bfloat16(device: str | torch.device) -> bool:
    """Return whether a device computes faster in bfloat16: a GPU from Ampere on, a CPU with `amx_bf16`, AMD from Zen 4.

    `avx512_bf16` alone does not tell: a pass of the builtin prior takes 0.7 times the CPU time of float32 on AMD, whose
    units multiply twice as many numbers in bfloat16, and took 1.4 to 1.5 times that on another processor without AMX.
    Before torch 2.9 the instructions of a CPU are not known.
    """
    if torch.device(device).type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    features: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    amd = str(features.get("cpu_name", "")).startswith("AMD")
    return bool(features.get("amx_bf16") or (amd and features.get("avx512_bf16")))
