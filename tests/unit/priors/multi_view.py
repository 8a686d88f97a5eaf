"""A multi-view adapter with random weights, under the published names, for the small checkpoint of the tests."""

from __future__ import annotations

import shutil
from pathlib import Path

import safetensors.torch
import torch
from torch import Tensor

FILE = "mvadapter_t2mv_sd21.safetensors"
LAYERS = {
    "down_blocks.0.attentions.0.transformer_blocks.0.attn1.processor": 32,
    "mid_block.attentions.0.transformer_blocks.0.attn1.processor": 64,
    "up_blocks.1.attentions.0.transformer_blocks.0.attn1.processor": 32,
    "up_blocks.1.attentions.1.transformer_blocks.0.attn1.processor": 32,
}
"""The self-attentions of the small U-Net of the second edition, and their widths."""


def adapter_tensors(seed: int = 7) -> dict[str, Tensor]:
    """Tensors of the right names and shapes, so large that the views matter to each other."""
    from diffusers import T2IAdapter

    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        tensors = dict(T2IAdapter(in_channels=6, channels=[32, 64], num_res_blocks=1).state_dict())
    for layer, width in LAYERS.items():
        for name in ("to_q_mv", "to_k_mv", "to_v_mv", "to_out_mv.0"):
            tensors[f"{layer}.{name}.weight"] = torch.randn(width, width, generator=generator) * (2 / width**0.5)
        tensors[f"{layer}.to_out_mv.0.bias"] = torch.randn(width, generator=generator)
    return tensors


def with_adapter(checkpoint: Path, folder: Path, tensors: dict[str, Tensor] | None = None) -> Path:
    """Copy a checkpoint and put an adapter into it."""
    shutil.copytree(checkpoint, folder)
    chosen = adapter_tensors() if tensors is None else tensors
    safetensors.torch.save_file(chosen, folder / FILE, {"format": "pt"})
    return folder
