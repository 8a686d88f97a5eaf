"""Measure Stable Diffusion models of true size with random weights: ``python -m bench.true_size --model 2.1-base``.

Writes a checkpoint of the real classes with the published sizes, loads it as a job does, and makes whole steps with it.
Prints memory and counted operations of a step by part; shares of the CPU time; on a GPU also seconds. Counts need no
trained weights: they depend on sizes alone. `--peak` states a device's operations per second, and what a step would
take at half of them is computed: an expectation, not a measurement.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from torch.utils.flop_counter import FlopCounterMode

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.requests.document import DeformParams, resolve
from tests.fakes import build_tiny_stable_diffusion

UTILISATION = 0.5
"""Share of a device's peak that large convolutions and matrix products commonly reach; an assumption."""
TEXT = {
    "2.1-base": {"hidden_size": 1024, "intermediate_size": 4096, "num_hidden_layers": 23, "num_attention_heads": 16},
}
STEP = "a step of 5,120 faces"
UNET: dict[str, dict[str, Any]] = {
    "2.1-base": {
        "cross_attention_dim": 1024,
        "attention_head_dim": (5, 10, 20, 20),
        "use_linear_projection": True,
    },
}


def build(model: str, folder: Path) -> Path:
    """Write a checkpoint of a published size into a folder; `tiny` is that of the tests."""
    build_tiny_stable_diffusion(folder, sample_size=16 if model == "tiny" else 64)
    if model == "tiny":
        return folder
    from diffusers import AutoencoderKL, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        # The vocabulary and the scheduler's table have the sizes of the small checkpoint: they cost nothing.
        config = CLIPTextConfig.from_pretrained(folder / "text_encoder").to_dict() | TEXT[model]
        CLIPTextModel(CLIPTextConfig(**config)).save_pretrained(folder / "text_encoder")
        UNet2DConditionModel(sample_size=64, **UNET[model]).save_pretrained(folder / "unet")
        AutoencoderKL(
            block_out_channels=(128, 256, 512, 512),
            down_block_types=("DownEncoderBlock2D",) * 4,
            up_block_types=("UpDecoderBlock2D",) * 4,
            layers_per_block=2,
            sample_size=512,
        ).save_pretrained(folder / "vae")
    return folder


def counted(action: Callable[[], object]) -> float:
    """Return the floating-point operations of an action's convolutions, matrix products and attention."""
    with FlopCounterMode(display=False) as counter:
        action()
    return float(counter.get_total_flops())


class Clock:
    """Seconds of actions: CPU time, or a GPU's own."""

    def __init__(self, device: torch.device) -> None:
        self._device = device

    def seconds(self, action: Callable[[], object]) -> float:
        """Return the seconds of one action."""
        if self._device.type != "cuda":
            begun = time.process_time()
            action()
            return time.process_time() - begun
        begin = torch.cuda.Event(enable_timing=True)  # type: ignore[no-untyped-call]
        end = torch.cuda.Event(enable_timing=True)  # type: ignore[no-untyped-call]
        begin.record()
        action()
        end.record()
        torch.cuda.synchronize(self._device)
        return float(begin.elapsed_time(end)) / 1e3


def measure(prior: StableDiffusionPrior, repeats: int) -> dict[str, tuple[float, float]]:
    """Return the counted operations and the seconds of each part of a step, and of the whole."""
    size, cameras = prior.image_size, fixed_cameras(20.0, 15.0)
    embedding = prior.encode_texts("a mushroom", "")
    noisy = torch.randn(1, 4, size // 8, size // 8, generator=torch.Generator().manual_seed(0)).to(prior.device)
    picture = torch.rand(1, 3, size, size, generator=torch.Generator().manual_seed(1)).to(prior.device)

    def encode() -> None:
        with torch.no_grad():
            prior.encode_image(picture)

    def encode_both() -> None:
        prior.encode_image(picture.clone().requires_grad_()).sum().backward()  # type: ignore[no-untyped-call]

    def predict() -> None:
        prior.predict_noise(noisy, torch.tensor([500]), embedding, cameras)

    guidance = ScoreDistillation(prior, "a mushroom", guidance_scale=100.0)
    params = resolve(DeformParams(steps=1000), default_model="random")
    run = iter(Deformation(icosphere(4, 0.6), guidance, params, device=str(prior.device)))
    actions: dict[str, Callable[[], object]] = {
        "encode the picture": encode,
        "encode, and its gradient": encode_both,
        "predict the noise twice": predict,
        STEP: lambda: next(run),
    }
    clock, found = Clock(prior.device), {}
    for name, action in actions.items():
        with patch.object(prior, "_replay_unet", prior._run_unet):  # what a graph replays cannot be counted
            flops = counted(action)
        action()
        found[name] = flops, min(clock.seconds(action) for _ in range(repeats))
    return found


def report(prior: StableDiffusionPrior, found: dict[str, tuple[float, float]], peak_tflops: float) -> None:
    """Print a table: seconds only of a GPU, where nothing else is at work."""
    on_gpu = prior.device.type == "cuda"
    whole = found[STEP][1]
    title = "ms" if on_gpu else "CPU time, share of a step"
    print(f"| | TFLOP | {title} | at {UTILISATION:.0%} of {peak_tflops:g} TFLOP/s |")
    print("|---|---|---|---|")
    for name, (flops, seconds) in found.items():
        expected = f"{1e3 * flops / (UTILISATION * peak_tflops * 1e12):.1f} ms (computed)" if peak_tflops else ""
        shown = f"{1e3 * seconds:.1f}" if on_gpu else f"{seconds / whole:.0%}"
        print(f"| {name} | {flops / 1e12:.3f} | {shown} | {expected} |")
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    memory = f"{used:.1f} GB of main memory at most"
    if on_gpu:
        memory += f", {torch.cuda.max_memory_allocated(prior.device) / 2**30:.1f} GB of the GPU's"
    print(f"\n{prior.dtype}, {prior.device}: {memory}")


def main() -> None:
    """Measure one model."""
    parser = argparse.ArgumentParser(prog="python -m bench.true_size", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--model", choices=["tiny", *UNET], default="2.1-base")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--peak", type=float, default=0.0, metavar="TFLOPS", help="a device's peak in this precision")
    options = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as scratch:
        folder = build(options.model, Path(scratch))
        size = sum(path.stat().st_size for path in folder.rglob("*.safetensors"))
        print(f"{options.model}: {size / 2**30:.2f} GB of weights in float32\n")
        prior = StableDiffusionPrior(str(folder), device=options.device)
        report(prior, measure(prior, 1), options.peak)


if __name__ == "__main__":
    main()
