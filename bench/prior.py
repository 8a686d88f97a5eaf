"""Measure the cost of a score distillation step with a prior, part by part.

    python -m bench.prior                         the builtin prior
    python -m bench.prior --model FOLDER_OR_ID    a Stable Diffusion checkpoint on this machine
    python -m bench.prior --model tiny            real classes, random weights: the overhead without the network

Prints the median seconds of each part and its share of the step.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable

import torch

from meshdeform.guidance.base import StepContext
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.priors.base import Prior
from meshdeform.rendering.cameras import fixed_cameras
from tests.fakes import build_tiny_stable_diffusion


def median_seconds(action: Callable[[], object], device: torch.device, repeats: int) -> float:
    """Return the median wall-clock time of `action` after one warm-up, with the device's queue drained."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        action()
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def parts(prior: Prior, prompt: str, scale: float, repeats: int) -> dict[str, float]:
    """Return the median seconds of the parts of a step, and of the whole."""
    cameras = fixed_cameras(30.0, 15.0)
    side = 2 * prior.style.view_size
    guidance = ScoreDistillation(prior, prompt, guidance_scale=scale)
    embedding, device = prior.encode_texts(prompt, "").flip(0), prior.alphas_cumprod.device
    image = torch.rand(1, 3, side, side, device=device, requires_grad=True)
    z_t = prior.encode_image(image).detach()
    timestep = torch.tensor([prior.num_timesteps // 2], device=device)
    generator = torch.Generator()

    def encode() -> None:
        with torch.no_grad():
            prior.encode_image(image)

    def encode_and_back() -> None:
        prior.encode_image(image).sum().backward()

    def predict() -> None:
        prior.predict_noise(z_t, timestep, embedding, cameras)

    def step() -> None:
        loss, _ = guidance.loss(image, StepContext(0, 1, cameras, generator))
        loss.backward()

    measured = {
        name: median_seconds(action, device, repeats)
        for name, action in (
            ("encode, forward", encode),
            ("encode, forward and backward", encode_and_back),
            ("predict noise (both branches)", predict),
            ("whole step", step),
        )
    }
    measured["encode a prompt (once per job)"] = median_seconds(lambda: prior.encode_texts(prompt, ""), device, repeats)
    return measured


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--model", default="builtin")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--prompt", default="a mushroom")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    with tempfile.TemporaryDirectory() as scratch:
        model = arguments.model
        if model == "tiny":
            model = str(build_tiny_stable_diffusion(scratch, sample_size=64))
        start = time.perf_counter()
        prior = load_prior(model, device=arguments.device)
        loading = time.perf_counter() - start
        measured = parts(prior, arguments.prompt, 7.5, arguments.repeats)
    whole = measured["whole step"]
    print(
        f"{arguments.model} on {prior.alphas_cumprod.device}, threads: {arguments.threads}, loaded in {loading:.1f} s"
    )
    for name, seconds in measured.items():
        print(f"{name:32} {seconds * 1e3:9.2f} ms  {seconds / whole:6.1%} of a step")


if __name__ == "__main__":
    main()
