"""Classifier-free guidance as the equation has it, to compare with."""

from __future__ import annotations

from torch import Tensor

from meshdeform.priors.base import Prior


def guided(uncond: Tensor, text: Tensor, guidance_scale: float) -> Tensor:
    """``uncond + s (text - uncond)``. Source: Ho & Salimans 2022, eq. 6, in diffusers' convention of s."""
    return uncond + guidance_scale * (text - uncond)


def text_rows(prior: Prior, prompt: str, negative_prompt: str = "") -> Tensor:
    """Rows of the negative prompt (or nothing) and of the prompt, in the order that `guided` takes predictions in."""
    return prior.encode_texts(prompt, negative_prompt).flip(0)
