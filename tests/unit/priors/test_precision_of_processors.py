"""What a processor is fastest in: training and teaching follow it, a run computes in float32 unless it is asked."""

from __future__ import annotations

import pytest
import torch

from meshdeform.priors import load_prior
from meshdeform.priors.builtin.teaching.teacher import fastest_precision
from meshdeform.priors.stable_diffusion import _dtype
from tests.cases import each_case

INTEL, AMD = {"cpu_name": "Intel(R) Xeon(R)"}, {"cpu_name": "AMD EPYC"}


@each_case(
    ("features", "teaching"),
    [
        ({**INTEL, "avx512_bf16": True, "amx_bf16": True}, "bf16"),
        ({**INTEL, "avx512_bf16": True, "amx_bf16": False}, "fp32"),
        ({**AMD, "avx512_bf16": True, "amx_bf16": False}, "bf16"),
        ({**AMD, "avx512_bf16": False, "amx_bf16": False}, "fp32"),
        ({"neon": True}, "fp32"),
    ],
)
def test_teaching_follows_the_processor(
    features: dict[str, bool | str], teaching: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: features)
    assert fastest_precision("cpu") == teaching
    assert _dtype("auto", torch.device("cpu")) is torch.float32


def test_what_concerns_pictures_computes_in_the_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(torch.cpu, "get_capabilities")  # an older torch does not know
    assert fastest_precision("cpu") == "fp32"
    assert load_prior("builtin", device="cpu").dtype is torch.float32
    prior = load_prior("builtin", device="cpu", dtype="bfloat16")
    weights = {name: tensor.dtype for name, tensor in prior._network.state_dict().items()}  # type: ignore[attr-defined]
    assert {dtype for name, dtype in weights.items() if name.startswith("middle")} == {torch.bfloat16}
    assert {dtype for name, dtype in weights.items() if name.startswith("text")} == {torch.float32}
