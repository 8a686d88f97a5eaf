"""The builtin prior's network in 8-bit integers: exact where it can be, and close to float32 as a whole."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from meshdeform.priors import load_prior
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.priors.builtin.prior import _dtype as builtin_dtype
from meshdeform.priors.builtin.quantized import quantize, quantize_normed, round_weights
from meshdeform.priors.builtin.teaching.teacher import fastest_precision
from meshdeform.priors.precision import is_fast_in_int8
from meshdeform.priors.stable_diffusion import _dtype
from meshdeform.rendering.cameras import fixed_cameras
from tests.cases import each_case

needs_instructions = pytest.mark.skipif(not is_fast_in_int8("cpu"), reason="this CPU has no instructions for bytes")


def _random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def _meant(values: np.ndarray, steps: np.ndarray) -> torch.Tensor:
    """Return the numbers that bytes (B, ...) mean."""
    step, zero = (torch.from_numpy(steps[:, k]).view(-1, 1, 1, 1) for k in range(2))
    return step * (torch.from_numpy(values).float() - zero)


@each_case("silu", [True, False])
def test_a_quantised_norm_is_within_half_a_step_of_that_of_torch(silu: bool) -> None:
    batch, channels, side, border = 2, 24, 5, 2
    x, gain, shift = (
        _random(batch, channels, side, side),
        _random(batch, channels, seed=1),
        _random(batch, channels, seed=2),
    )
    expected = functional.group_norm(x, 8) * gain[:, :, None, None] + shift[:, :, None, None]
    expected = functional.silu(expected) if silu else expected
    found = np.empty((batch, side + 2 * border, side + 2 * border, channels), np.uint8)
    rows = x.permute(0, 2, 3, 1).contiguous().numpy()
    steps = np.empty((batch, 2), np.float32)
    quantize_normed(rows, gain.numpy(), shift.numpy(), 8, silu, border, found, steps)
    values = _meant(found, steps).permute(0, 3, 1, 2)
    apart = (values[:, :, border:-border, border:-border] - expected).abs()
    # SiLU itself is off by at most 0.0002.
    assert (apart.amax((1, 2, 3)) <= 0.5001 * torch.from_numpy(steps[:, 0]) + 0.00021).all()
    assert all(picture.max() - picture.min() >= 250 for picture in found)  # hardly a level is wasted
    around = torch.ones_like(values, dtype=torch.bool)
    around[:, :, border:-border, border:-border] = False
    assert not values[around].any()
    # Without a norm: 0 is always a level, also outside of what there is.
    for low, high in ((-3.0, 5.0), (2.0, 5.0), (-5.0, -2.0), (0.0, 0.0)):
        x = torch.linspace(low, high, 2 * 3 * 3 * 4).view(2, 3, 3, 4)
        found = np.empty((2, 5, 5, 4), np.uint8)
        steps = np.empty((2, 2), np.float32)
        quantize(x.numpy(), 1, found, steps)
        values = _meant(found, steps)
        assert not values[:, 0].any()
        assert ((steps[:, 1] >= 0) & (steps[:, 1] <= 255)).all()
        assert ((values[:, 1:-1, 1:-1] - x).abs().amax((1, 2, 3)) <= 0.5001 * torch.from_numpy(steps[:, 0])).all()


def test_weights_are_rounded_so_that_their_sums_are_kept() -> None:
    weights = np.array([[[0.4, 0.35, 0.45, 0.4]], [[-0.4, -0.4, -0.3, -0.3]], [[1.2, -3.0, 0.9, 2.0]]], np.float32)
    assert round_weights(weights, 3).tolist() == [[[1, 0, 1, 0]], [[-1, 0, 0, 0]], [[1, -3, 1, 2]]]
    # Each kernel by itself, then the whole filter.
    weights = np.array([[[0.4], [0.4], [0.3]]], np.float32)
    assert round_weights(weights, 3).tolist() == [[[1], [0], [0]]]
    weights = (63 * np.random.default_rng(0).uniform(-1, 1, (7, 40, 9))).astype(np.float32)
    weights[:, :, 0] = 63.0  # where there is no other neighbour
    error = weights - round_weights(weights, 63)
    assert (np.abs(error) < 1).all()
    assert (np.abs(round_weights(weights, 63)) <= 63).all()
    assert (np.abs(error.sum((1, 2), np.float64)) <= 0.5001).all()
    nearest = weights - np.round(weights)
    assert np.abs(error.sum(2)).mean() < 0.5 * np.abs(nearest.sum(2)).mean()


@needs_instructions
@each_case("value", [1.0, -1.0])
def test_no_sum_of_bytes_is_cut_off(value: float) -> None:
    # AVX2 adds up two products of bytes in 16 bits and cuts off what is more: with weights of 8 bits, this would be.
    from meshdeform.priors.builtin import quantized

    layer = nn.Conv2d(64, 8, 3, padding=1, bias=False)
    with torch.no_grad():
        layer.weight.fill_(value)
        found = quantized._Convolution(layer)(torch.ones(1, 64, 4, 4))
        torch.testing.assert_close(found, layer(torch.ones(1, 64, 4, 4)), rtol=1e-4, atol=1e-4)


@needs_instructions
@each_case(
    "layer", [nn.Conv2d(6, 5, 3, padding=1), nn.Conv2d(6, 5, 3, stride=2, padding=1), nn.Conv2d(6, 5, 1, bias=False)]
)
def test_a_convolution_of_bytes_is_that_of_the_numbers_they_mean(layer: nn.Conv2d) -> None:
    from meshdeform.priors.builtin import quantized

    with torch.no_grad():
        layer.weight.copy_(_random(*layer.weight.shape))
        steps = layer.weight.abs().amax((1, 2, 3), keepdim=True) / 63
        signed = round_weights((layer.weight / steps).flatten(2).numpy(), 63)
        rounded = torch.from_numpy(signed).view_as(layer.weight) * steps
        x = _random(2, 6, 8, 8, seed=3) + 0.7
        border = int(layer.padding[0])
        levels = quantized._levels(x.permute(0, 2, 3, 1).contiguous().numpy(), border)
        meant = _meant(levels.values, levels.steps).permute(0, 3, 1, 2)
        inner = meant[:, :, border : 8 + border, border : 8 + border]
        expected = functional.conv2d(inner, rounded, layer.bias, layer.stride, layer.padding)
        made = quantized._Convolution(layer)
        torch.testing.assert_close(made(levels), expected, rtol=1e-4, atol=1e-4)
        rows = expected.permute(0, 2, 3, 1).contiguous()
        torch.testing.assert_close(torch.from_numpy(made.to_rows(levels, rows.numpy())), 2 * rows, rtol=1e-4, atol=1e-4)
        # Packed for one size, it takes others; and a picture does not depend on those beside it.
        for n in range(2):
            assert torch.equal(made(x[n : n + 1])[0], made(x)[n])


@needs_instructions
def test_an_operator_that_computes_something_else_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    from meshdeform.priors.builtin import quantized

    assert quantized.is_usable()
    packed = quantized._Convolution.forward
    monkeypatch.setattr(quantized._Convolution, "forward", lambda self, x: packed(self, x) + 1)
    assert not quantized.is_usable.__wrapped__()
    monkeypatch.setattr(quantized._Convolution, "forward", lambda *_: torch.ops.onednn.no_such_operator())
    assert not quantized.is_usable.__wrapped__()


@needs_instructions
def test_the_network_in_bytes_predicts_what_it_predicts_in_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    exact, rough = (BuiltinPrior(dtype=name) for name in ("float32", "int8"))
    assert rough.dtype is torch.int8
    rows = exact.encode_texts("a tall mushroom", "", "a dog")
    torch.testing.assert_close(rough.encode_texts("a tall mushroom", "", "a dog"), rows)
    noise = _random(1, 3, 128, 128)
    for cameras in (fixed_cameras(20.0, 10.0), fixed_cameras((20.0,), 10.0)):
        for texts in (1, 2, 3):
            one, other = (
                torch.stack(prior.predict_noise(noise, torch.tensor([600]), rows[:texts], cameras))
                for prior in (exact, rough)
            )
            # In units of the noise; its own standard deviation is 1.
            assert (one - other).square().mean().sqrt() < 0.03
            with monkeypatch.context() as threads:
                threads.setattr("meshdeform.support.threads._chosen", 3)
                shared = torch.stack(rough.predict_noise(noise, torch.tensor([600]), rows[:texts], cameras))
            assert torch.equal(other, shared)


# The builtin prior computes in what the processor is fastest in, unless a setting says otherwise.


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
