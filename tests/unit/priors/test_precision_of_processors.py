"""In which precision a run computes: in float32 on a processor, unless it is asked for another one."""

from __future__ import annotations

import torch

from meshdeform.priors import load_prior
from meshdeform.priors.stable_diffusion import _dtype


def test_what_concerns_pictures_computes_in_the_precision() -> None:
    assert _dtype("auto", torch.device("cpu")) is torch.float32
    assert load_prior("builtin", device="cpu").dtype is torch.float32
    prior = load_prior("builtin", device="cpu", dtype="bfloat16")
    weights = {name: tensor.dtype for name, tensor in prior._network.state_dict().items()}  # type: ignore[attr-defined]
    assert {dtype for name, dtype in weights.items() if name.startswith("middle")} == {torch.bfloat16}
    assert {dtype for name, dtype in weights.items() if name.startswith("text")} == {torch.float32}
