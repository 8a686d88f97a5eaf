"""Tell in which precision a processor computes fastest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

__all__ = ["has_bfloat16"]


def has_bfloat16(device: str | torch.device) -> bool:
    """Return whether a device multiplies matrices in bfloat16 natively: Ampere and later; `avx512_bf16`, `amx_bf16`.

    Others emulate it, more slowly than they compute in float32. Before torch 2.9 this is not known of a CPU.
    """
    if torch.device(device).type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    features: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return any(bool(features.get(name)) for name in ("avx512_bf16", "amx_bf16"))
