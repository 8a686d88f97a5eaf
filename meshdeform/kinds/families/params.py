"""Declare the parameters of the kinds `family_fit` and `family_synthesize`. Torch-free."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field, StringConstraints

from meshdeform.requests.declaration import StrictModel

MAX_SYNTHESES = 64

RETIRED = {"family_synthesize": frozenset({"max_defect"})}

_Member = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
_Part = Annotated[str, StringConstraints(min_length=1, max_length=64)]


class SynthesisMode(StrEnum):
    """Ways to make new shapes of a family."""

    SAMPLE = "sample"
    INTERPOLATE = "interpolate"
    COMPLETE = "complete"
    SEARCH = "search"


class FamilyParams(StrictModel):
    """The parameters of a family's fit."""

    points: int = Field(500, ge=20, le=1000, description="Number of template points, over all parts.", examples=[300])
    samples: int = Field(1000, ge=50, le=4000, description="Number of samples of each surface.", examples=[600])
    read: bool = Field(
        True,
        description="Read each asset by its noun first: its parts have the noun's names, and where assets are "
        "labelled, what is read helps to find their parts in the others.",
        examples=[True],
    )
    noun: str | None = Field(
        None,
        min_length=1,
        max_length=100,
        description="What all assets are, a noun of the builtin prior. Default: recognised.",
        examples=["chair"],
    )
    parts: int = Field(
        4,
        ge=2,
        le=16,
        description="Number of parts if no asset is labelled and none is read; otherwise labels or readings have it.",
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


class FamilySynthesisParams(StrictModel):
    """The parameters of a family's synthesis."""

    mode: SynthesisMode = Field(
        SynthesisMode.SAMPLE,
        description="`sample`: new shapes. `interpolate`: shapes between two members, which are the first and the last "
        "one. `complete`: shapes that have some parts of a member. `search`: no new shapes; the nearest members.",
        examples=["sample"],
    )
    count: int = Field(
        4,
        ge=1,
        le=MAX_SYNTHESES,
        description="Number of shapes; for `search`, of members.",
        examples=[8],
    )
    members: list[_Member] = Field(
        default_factory=list,
        max_length=2,
        description="Names of members, as the collection has them: two for `interpolate`, one for `complete` and "
        "`search`.",
        json_schema_extra={"x-option": "member"},
        examples=[["chair_01.glb", "chair_02.glb"]],
    )
    keep: list[_Part] = Field(
        default_factory=list,
        max_length=16,
        description="For `complete`: names of the parts of the member that stay exactly as they are.",
        examples=[["seat", "leg"]],
    )
    seed: int = Field(0, ge=0, le=2**63 - 1, description="Seed of the sampling.", examples=[0])
    checkpoint_every_steps: int = Field(4, ge=1, le=10_000, description="Steps between two checkpoints.", examples=[10])


PARAMS = {"family_fit": FamilyParams, "family_synthesize": FamilySynthesisParams}
