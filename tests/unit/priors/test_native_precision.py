"""The builtin prior computes in what the processor is fastest in, unless a setting says otherwise."""

from __future__ import annotations

import platform
import re
from pathlib import Path

import pytest
import torch

from meshdeform.priors import load_prior
from meshdeform.priors.builtin.prior import _dtype as builtin_dtype
from meshdeform.priors.builtin.teaching.teacher import fastest_precision
from meshdeform.priors.native_precision import is_fast_in_bfloat16, is_fast_in_int8
from meshdeform.priors.stable_diffusion import _dtype
from tests.cases import each_case

CPUINFO = Path("/proc/cpuinfo")


@pytest.mark.skipif(platform.machine() != "x86_64" or not CPUINFO.exists(), reason="reads the flags of Linux on x86")
def test_torch_knows_what_the_kernel_says_of_this_processor() -> None:
    told = CPUINFO.read_text()
    flag = r"\bavx512_bf16\b" if re.search(r"^model name\s*: AMD", told, re.MULTILINE) else r"\bamx_bf16\b"
    assert is_fast_in_bfloat16("cpu") == bool(re.search(flag, told))
    assert is_fast_in_int8("cpu") == bool(re.search(r"\bavx2\b", told))


INTEL, AMD = {"cpu_name": "Intel(R) Xeon(R)"}, {"cpu_name": "AMD EPYC"}


@each_case(
    ("features", "expected", "teaching"),
    [
        ({**INTEL, "avx2": True, "avx512_bf16": True, "amx_bf16": True}, torch.int8, "bf16"),
        ({**INTEL, "avx2": True, "avx512_bf16": True, "amx_bf16": False}, torch.int8, "fp32"),
        ({**AMD, "avx2": True, "avx512_bf16": True, "amx_bf16": False}, torch.int8, "bf16"),
        ({**AMD, "avx2": True, "avx512_bf16": False, "amx_bf16": False}, torch.int8, "fp32"),
        ({**AMD, "avx2": False, "avx512_bf16": False, "amx_bf16": False}, torch.float32, "fp32"),
        ({"neon": True}, torch.float32, "fp32"),
    ],
)
def test_auto_follows_the_processor(
    features: dict[str, bool | str], expected: torch.dtype, teaching: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: features)
    monkeypatch.setattr("meshdeform.priors.builtin.quantized.is_usable", lambda: True)
    device = torch.device("cpu")
    assert builtin_dtype("auto", device) is builtin_dtype("int8", device) is expected
    assert fastest_precision("cpu") == teaching
    # Asked for by name, a precision is what it was; that of Stable Diffusion on a CPU does not change.
    assert builtin_dtype("float32", device) is torch.float32
    assert builtin_dtype("bfloat16", device) is torch.bfloat16
    assert _dtype("auto", device) is _dtype("int8", device) is torch.float32
    # Another version of torch may have another operator.
    monkeypatch.setattr("meshdeform.priors.builtin.quantized.is_usable", lambda: False)
    assert builtin_dtype("auto", device) is builtin_dtype("int8", device) is torch.float32


def test_what_concerns_pictures_computes_in_the_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(torch.cpu, "get_capabilities")  # an older torch does not know
    assert load_prior("builtin", device="cpu").dtype is torch.float32
    prior = load_prior("builtin", device="cpu", dtype="bfloat16")
    weights = {name: tensor.dtype for name, tensor in prior._network.state_dict().items()}  # type: ignore[attr-defined]
    assert {dtype for name, dtype in weights.items() if name.startswith("middle")} == {torch.bfloat16}
    assert {dtype for name, dtype in weights.items() if name.startswith("text")} == {torch.float32}
