"""Declare the parameters of the kind `prior_teach`. Torch-free."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StringConstraints

from meshdeform.requests.choices import BUILTIN_MODEL
from meshdeform.requests.declaration import StrictModel
from meshdeform.requests.parameters import MAX_STEPS

TEACH_STEPS, TEACH_STEPS_FURTHER = 600, 60
"""Most steps of a lesson, unless it says otherwise, and what a kit takes more for each noun but the first."""
MAX_SYNONYMS = 16

_Name = Annotated[str, StringConstraints(min_length=1, max_length=80)]


class TeachParams(StrictModel):
    """The parameters of a lesson."""

    noun: _Name | None = Field(
        None,
        description="Word for the meshes. Leave it out for a kit: a ZIP in which folders, or the files in none, are "
        "named by nouns, and folders in those by attributes.",
        examples=["a gnome"],
    )
    synonyms: list[_Name] = Field(
        default_factory=list,
        max_length=MAX_SYNONYMS,
        description="Other names of the noun.",
        json_schema_extra={"x-option": "synonym"},
        examples=[["dwarf"]],
    )
    replace: bool = Field(
        False,
        description="Give a noun that the model knows a new meaning; otherwise such a noun is refused.",
        examples=[False],
    )
    licence: str = Field(
        "",
        max_length=500,
        description="One line about the licence of the meshes, kept in the weights.",
        examples=["CC0-1.0"],
    )
    front_deg: float = Field(
        0.0,
        ge=-360.0,
        le=360.0,
        description="Azimuth of the front of the meshes in degrees: 0 is +Z, 90 is +X.",
        json_schema_extra={"x-option": "front"},
        examples=[0.0],
    )
    model: str = Field(
        BUILTIN_MODEL,
        min_length=1,
        max_length=500,
        description="Model to start from, and to which the word is added: `builtin`, a file of `meshdeform teach`, "
        "`job:ID` with the id of another job of this kind, or `weights`: the part `weights`.",
        examples=["builtin"],
    )
    steps: int = Field(
        TEACH_STEPS,
        ge=1,
        le=MAX_STEPS,
        description="Most steps of the training, which ends when held-out pictures are no longer predicted better. "
        f"A kit needs about {TEACH_STEPS_FURTHER} more for each noun but the first.",
        examples=[600],
    )
    seed: int = Field(0, ge=0, le=2**31 - 1, description="Seed of the pictures and of the training.", examples=[0])
    checkpoint_every_steps: int = Field(
        50, ge=1, le=10_000, description="Steps between two checkpoints.", examples=[50]
    )
