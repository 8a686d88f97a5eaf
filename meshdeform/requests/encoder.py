"""Declare the parameter that chooses the encoder of a Stable Diffusion model. Torch-free."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from meshdeform.requests.choices import Encoder

__all__ = ["ENCODER", "Encoder"]

ENCODER: Any = Field(
    Encoder.VAE,
    description="With a Stable Diffusion model, what turns the views into latents: `vae`, the model's own; or `tiny`, "
    "the small autoencoder in its folder `vae_tiny`, a fraction of the work "
    "([Configuration](configuration.md#a-small-encoder)). The built-in model has none.",
    examples=["tiny"],
)
