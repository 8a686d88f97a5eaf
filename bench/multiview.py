"""Count a step of the multi-view prior at true size: ``python -m bench.multiview --peak 989``.

The real classes at the sizes of Stable Diffusion 2.1 base and its adapter, on torch's device `meta`: operations and
bytes are counted from shapes, and nothing is computed, so it takes seconds and no weights. `--peak` states a device's
operations per second; what a step would take at half of them is an expectation, not a measurement.

`--real` writes such a checkpoint with random weights instead (5.1 GB), loads it as a job does, and makes one step with
the small encoder on the CPU: minutes on one core.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from bench.true_size import UNET, UTILISATION, build, counted
from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.priors.multiview.adapter_file import ADAPTER
from meshdeform.priors.multiview.network import AdapterModules
from meshdeform.priors.multiview.prior import RIG, MultiViewPrior
from meshdeform.requests.choices import Encoder
from meshdeform.requests.document import DeformParams, resolve

VIEWS = len(RIG.azimuths_deg)
SIDE, LATENTS, TEXTS = 512, 64, 2


def networks() -> tuple[Any, Any, Any]:
    """Return the U-Net and both encoders of Stable Diffusion 2.1 base, without values."""
    from diffusers import AutoencoderKL, AutoencoderTiny, UNet2DConditionModel

    with torch.device("meta"):
        unet = UNet2DConditionModel(sample_size=LATENTS, **UNET["2.1-base"])
        vae = AutoencoderKL(
            block_out_channels=(128, 256, 512, 512),
            down_block_types=("DownEncoderBlock2D",) * 4,
            up_block_types=("UpDecoderBlock2D",) * 4,
            layers_per_block=2,
        )
        return unet.eval(), vae.encoder.eval(), AutoencoderTiny().encoder.eval()


@contextmanager
def kept() -> Iterator[dict[int, int]]:
    """Collect the bytes of each tensor that is kept for a gradient, by its storage."""
    sizes: dict[int, int] = {}
    alive = []

    def pack(tensor: Tensor) -> Tensor:
        storage = tensor.untyped_storage()
        if not isinstance(tensor, torch.nn.Parameter):
            sizes[storage._cdata] = storage.nbytes()
            alive.append(storage)  # so that no other one gets its place
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        yield sizes


def encode(encoder: Any, views: int) -> Callable[[], object]:
    """Return the action that encodes pictures, with the gradient on them."""
    encoder.requires_grad_(requires_grad=False)

    def action() -> None:
        pictures = torch.zeros(views, 3, SIDE, SIDE, device="meta", requires_grad=True)
        encoder(pictures).sum().backward()

    return action


def predict(unet: Any, features: list[Tensor] | None, views: int) -> Callable[[], object]:
    """Return the action that predicts the noise of all views for two texts."""

    @torch.no_grad()
    def action() -> None:
        batch = TEXTS * views
        latents = torch.zeros(batch, 4, LATENTS, LATENTS, device="meta")
        words = torch.zeros(batch, 77, UNET["2.1-base"]["cross_attention_dim"], device="meta")
        given = {} if features is None else {"down_intrablock_additional_residuals": [f.clone() for f in features]}
        unet(latents, torch.zeros(batch, device="meta"), encoder_hidden_states=words, **given)

    return action


def run_one_step() -> None:
    """Make a step with random weights of true size, and print the shares of its CPU time and the memory."""
    from safetensors.torch import save_file

    with tempfile.TemporaryDirectory() as scratch:
        folder = build("2.1-base", Path(scratch))
        adapter = AdapterModules.of(networks()[0], views=VIEWS, shrink=SIDE // LATENTS)
        generator = torch.Generator().manual_seed(0)
        random = {
            name: 0.02 * torch.randn(tensor.shape, generator=generator) for name, tensor in adapter.tensors().items()
        }
        save_file(random, folder / ADAPTER, {"format": "pt"})
        del random
        prior = load_prior(str(folder), device="cpu")
        assert isinstance(prior, MultiViewPrior)
        spent, predict_noise = {"predict": 0.0}, prior.predict_noise

        def timed(*given: Any) -> tuple[Tensor, ...]:
            begun = time.process_time()
            found = predict_noise(*given)
            spent["predict"] += time.process_time() - begun
            return found

        small = prior.with_encoder(Encoder.TINY)
        small.predict_noise = timed  # type: ignore[method-assign, assignment]
        params = resolve(DeformParams(steps=2, safeguard="none"), default_model="random")
        guidance = ScoreDistillation(small, "a mushroom", guidance_scale=100.0)
        steps = iter(Deformation(icosphere(4, 0.6), guidance, params))
        next(steps)  # the features of the cameras are made once
        begun, spent["predict"] = time.process_time(), 0.0
        losses = next(steps).losses
        whole = time.process_time() - begun
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"a step of 5,120 faces: gradient on the latents {losses['sds_gradient_norm']:.1f}")
    print(f"prediction: {spent['predict'] / whole:.0%} of the CPU time; {used:.1f} GB of main memory at most")


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(prog="python -m bench.multiview", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--peak", type=float, default=0.0, metavar="TFLOPS", help="a device's peak")
    parser.add_argument("--real", action="store_true", help="make a step with random weights")
    options = parser.parse_args()
    if options.real:
        run_one_step()
        return
    peak = options.peak
    unet, vae, small = networks()
    counts = {
        "predict one picture, without an adapter": counted(predict(unet, None, 1)),
        "predict six views, without an adapter": counted(predict(unet, None, VIEWS)),
    }
    adapter = AdapterModules.of(unet, views=VIEWS, shrink=SIDE // LATENTS)
    parameters = sum(tensor.numel() for tensor in adapter.tensors().values())
    adapter.join(unet)
    planes = torch.zeros(VIEWS, 6, SIDE, SIDE, device="meta")
    features: list[Tensor] = []
    with torch.no_grad():
        cameras = counted(lambda: features.extend(adapter.encoder(planes)))
    held = sum(tensor.numel() for tensor in features)
    repeated = [feature.repeat(TEXTS, 1, 1, 1) for feature in features]
    counts["predict six views with it"] = counted(predict(unet, repeated, VIEWS))
    memory = {}
    for name, encoder in (("VAE", vae), ("small encoder", small)):
        with kept() as sizes:
            counts[f"encode six views with the {name}, with the gradient"] = counted(encode(encoder, VIEWS))
        memory[name] = sum(sizes.values())
    print("| for two texts | TFLOP | at half of the peak |\n|---|---|---|")
    for name, flops in counts.items():
        expected = f"{1e3 * flops / (UTILISATION * peak * 1e12):.1f} ms (computed)" if peak else ""
        print(f"| {name} | {flops / 1e12:.2f} | {expected} |")
    print(f"\nadapter: {parameters / 1e6:.0f} million parameters; features of the cameras, made once: ", end="")
    print(f"{cameras / 1e12:.2f} TFLOP, {held / 1e6:.1f} million numbers")
    for name, size in memory.items():
        print(f"kept for the gradient of the {name}: {size / 2**30:.1f} GB in float32, half in half precision")


if __name__ == "__main__":
    main()
