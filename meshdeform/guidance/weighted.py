"""Name a prompt with its weight among several."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WeightedPrompt:
    """One of several prompts."""

    text: str
    weight: float = 1.0  # factor of its gradient
    group: int = 0
    """Prompts of one group share a loss. Groups count from 0, in the order of their first prompts."""
