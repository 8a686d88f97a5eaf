"""Define the documents about models."""

from __future__ import annotations

from pydantic import BaseModel, Field

__all__ = ["LessonView", "ModelList", "ModelView", "VocabularyView"]


class VocabularyView(BaseModel):
    """The vocabulary of a model."""

    nouns: list[str] = Field(
        description="The objects that it can make; a prompt names one of them.", examples=[["giraffe"]]
    )
    attributes: list[str] = Field(
        description="Properties of an object or of its parts.", examples=[["tall", "long neck", "short neck"]]
    )
    parts: dict[str, list[str]] = Field(
        description="The parts of each noun's object.", examples=[{"giraffe": ["head", "legs", "neck"]}]
    )
    max_attributes: int = Field(ge=0, description="Attributes allowed in one prompt.", examples=[3])
    examples: list[str] = Field(
        description="Examples of prompts.", examples=[["a giraffe with a long neck", "a tall vase"]]
    )
    groups: dict[str, list[str]] = Field(
        default_factory=dict, description="The nouns by kind.", examples=[{"animals": ["giraffe"]}]
    )


class LessonView(BaseModel):
    """What the builtin model was taught by `meshdeform teach`."""

    noun: str = Field(description="The noun.", examples=["gnome"])
    synonyms: list[str] = Field(description="Other names of it.", examples=[["dwarf"]])
    attributes: list[str] = Field(description="Attributes that its meshes were labelled with.", examples=[["tall"]])
    meshes: list[str] = Field(description="The names of its meshes.", examples=[["round.glb", "tall/garden.obj"]])
    licence: str = Field(description="What was said about the licence of the meshes.", examples=["CC0-1.0"])
    date: str = Field(description="The day of the lesson.", examples=["2026-11-22"])
    steps: int = Field(ge=0, description="Steps of the training.", examples=[600])
    seed: int = Field(description="Its seed.", examples=[0])


class ModelView(BaseModel):
    """A model that jobs may use."""

    id: str = Field(description="The value for `params.guidance.model`.", examples=["builtin"])
    title: str = Field(description="Its display name.", examples=["Builtin"])
    description: str = Field(
        description="Its description.", examples=["The small demonstration model that comes with Meshdeform."]
    )
    available: bool | None = Field(
        description="Whether it can be loaded; null if this server cannot check that.", examples=[True]
    )
    problem: str | None = Field(description="Why it is not available and what to do, else null.", examples=[None])
    vocabulary: VocabularyView | None = Field(description="The words that it understands; null: any prompt.")
    licence: str = Field("", description="What its model card states; empty: unknown.", examples=["mit"])
    lessons: list[LessonView] = Field(
        default_factory=list,
        description="What the builtin model was taught; empty for every other model.",
    )


class ModelList(BaseModel):
    """The models of this server."""

    default: str = Field(description="The model of jobs that name none.", examples=["builtin"])
    models: list[ModelView] = Field(description="The models, the default first.")
