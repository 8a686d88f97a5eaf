"""The builtin prior computes in bfloat16 where the processor does, unless a setting says otherwise."""

from __future__ import annotations

import platform
import re
from pathlib import Path

import pytest
import torch

from meshdeform.priors import load_prior
from meshdeform.priors.builtin.teaching.teacher import fastest_precision
from meshdeform.priors.native_precision import is_fast_in_bfloat16
from meshdeform.priors.stable_diffusion import _dtype
from tests.cases import each_case

CPUINFO = Path("/proc/cpuinfo")


@pytest.mark.skipif(platform.machine() != "x86_64" or not CPUINFO.exists(), reason="reads the flags of Linux on x86")
def test_torch_knows_what_the_kernel_says_of_this_processor() -> None:
    told = CPUINFO.read_text()
    flag = r"\bavx512_bf16\b" if re.search(r"^model name\s*: AMD", told, re.MULTILINE) else r"\bamx_bf16\b"
    assert is_fast_in_bfloat16("cpu") == bool(re.search(flag, told))


@each_case(
    ("features", "expected"),
    [
        ({"avx512_bf16": True, "amx_bf16": True}, torch.bfloat16),
        ({"avx512_f": True, "avx512_bf16": True, "amx_bf16": False, "cpu_name": "Intel(R) Xeon(R)"}, torch.float32),
        ({"avx512_f": True, "avx512_bf16": True, "amx_bf16": False, "cpu_name": "AMD EPYC"}, torch.bfloat16),
        ({"avx512_f": True, "avx512_bf16": False, "amx_bf16": False, "cpu_name": "AMD EPYC"}, torch.float32),
        ({"neon": True}, torch.float32),
    ],
)
def test_auto_follows_the_processor(
    features: dict[str, bool | str], expected: torch.dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: features)
    prior = load_prior("builtin", device="cpu")
    assert prior.dtype is expected
    weights = {name: tensor.dtype for name, tensor in prior._network.state_dict().items()}  # type: ignore[attr-defined]
    assert {dtype for name, dtype in weights.items() if name.startswith("middle")} == {expected}
    assert {dtype for name, dtype in weights.items() if name.startswith("text")} == {torch.float32}
    assert fastest_precision("cpu") == ("bf16" if expected is torch.bfloat16 else "fp32")
    # Asked for by name, a precision is what it was; that of Stable Diffusion on a CPU does not change.
    assert load_prior("builtin", device="cpu", dtype="float32").dtype is torch.float32
    assert load_prior("builtin", device="cpu", dtype="bfloat16").dtype is torch.bfloat16
    assert _dtype("auto", torch.device("cpu")) is torch.float32


def test_an_older_torch_does_not_know(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(torch.cpu, "get_capabilities")
    assert load_prior("builtin", device="cpu").dtype is torch.float32
