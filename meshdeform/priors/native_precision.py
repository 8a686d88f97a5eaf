"""Tell in which precision a processor computes fastest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch


def is_fast_in_bfloat16(device: str | torch.device) -> bool:
    """Return whether a device computes faster in bfloat16: a GPU from Ampere on, a CPU with `amx_bf16`, AMD from Zen 4.

    `avx512_bf16` alone does not tell: a pass of the builtin prior takes 0.7 times the CPU time of float32 on AMD, whose
    units multiply twice as many numbers in bfloat16, and took 1.4 to 1.5 times that on another processor without AMX.
    """
    if torch.device(device).type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    features = _features()
    amd = str(features.get("cpu_name", "")).startswith("AMD")
    return bool(features.get("amx_bf16") or (amd and features.get("avx512_bf16")))


def is_fast_in_int8(device: str | torch.device) -> bool:
    """Return whether a device is a CPU with vector instructions for bytes, `avx2`.

    A pass of the builtin prior takes 0.60 times the CPU time of float32, and less where `avx512_vnni` multiplies and
    adds up in one instruction in place of three.
    """
    return torch.device(device).type == "cpu" and bool(_features().get("avx2"))


def _features() -> Mapping[str, Any]:
    """Return what torch knows of this CPU: nothing before torch 2.9."""
    found: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return found
