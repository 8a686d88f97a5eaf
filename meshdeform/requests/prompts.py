"""Declare further prompts of a job. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field, StringConstraints, model_validator

from meshdeform.requests.declaration import StrictModel
from meshdeform.requests.selection import MAX_SELECTORS, Selection

__all__ = [
    "MAX_PROMPTS",
    "Prompt",
    "active_prompts",
    "prompt_words",
]


MAX_PROMPTS = 8
_MAX_LENGTH = 1_000
_MAX_WEIGHT = 100.0

_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=_MAX_LENGTH)]


class Prompt(StrictModel):
    """One of several prompts that guide at the same time."""

    prompt: _Text = Field(description="What the asset, or its region, should become.", examples=["a rabbit"])
    weight: float = Field(
        1.0,
        ge=0.0,
        le=_MAX_WEIGHT,
        description="How strongly it pulls, relative to the others; 0: not at all. `prompt` of the request has the "
        "weight 1. Where the weights add up to more than 1, they are divided by their sum.",
        examples=[0.5],
    )
    regions: tuple[Selection, ...] = Field(
        (),
        max_length=MAX_SELECTORS,
        description="The parts of the surface that it pulls at. Default: everything.",
        examples=[[{"box": {"min": [-1.0, 1.0, -1.0], "max": [1.0, 2.0, 1.0]}}]],
    )
    outside: bool = Field(False, description="Pull at everything outside of `regions` instead.", examples=[False])

    @model_validator(mode="after")
    def _outside_of_something(self) -> Self:
        if self.outside and not self.regions:
            raise ValueError("outside needs regions")
        return self


def active_prompts(prompt: str, prompts: tuple[Prompt, ...]) -> list[Prompt]:
    """Return the prompts that pull at anything, that of the request first; there may be none."""
    found = [Prompt(prompt=prompt)] if prompt else []
    return [*found, *(each for each in prompts if each.weight > 0)]


def prompt_words(prompt: str, params: Any) -> str:
    """Return all prompts of a job in one line; parameters of another kind of job have none of their own."""
    # A client keeps parameters of a later service as they came, in whatever form that writes them.
    prompts = getattr(params, "prompts", ())
    further = [each.get("prompt") if isinstance(each, Mapping) else getattr(each, "prompt", "") for each in prompts]
    return " + ".join(dict.fromkeys(text for text in (prompt, *further) if text))
