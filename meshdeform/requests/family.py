"""Declare the parameters of the kind `family_fit`. Torch-free."""

from __future__ import annotations

from pydantic import Field

from meshdeform.requests.strict import StrictModel

__all__ = ["FamilyParams"]


class FamilyParams(StrictModel):
    """The parameters of a family's fit."""

    points: int = Field(500, ge=20, le=1000, description="Number of template points, over all parts.", examples=[300])
    samples: int = Field(1000, ge=50, le=4000, description="Number of samples of each surface.", examples=[600])
    parts: int = Field(
        4,
        ge=2,
        le=16,
        description="Number of parts if no asset is labelled; otherwise the labels have it.",
        examples=[5],
    )
    iterations: int = Field(20, ge=1, le=200, description="Rounds of the mean-field inference.", examples=[20])
    epochs: int = Field(300, ge=1, le=5000, description="Epochs of the Beta shape machine.", examples=[300])
    turn: bool = Field(
        True,
        description="Turn assets around +Y until all face one way. Those that do already stay as they are.",
        examples=[True],
    )
    embed_labels: bool = Field(
        False,
        description="Also write `labelled.zip`: the assets as GLB with the vertex attribute `_PART`.",
        examples=[False],
    )
    seed: int = Field(0, ge=0, le=2**63 - 1, description="Seed of the samples and of the learning.", examples=[0])
    checkpoint_every_steps: int = Field(
        10, ge=1, le=10_000, description="Steps between two checkpoints.", examples=[10]
    )
