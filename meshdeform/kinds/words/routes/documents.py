"""The document of a word that is added."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from meshdeform.api.limits import MAX_FILENAME
from meshdeform.words.limits import MAX_SHAPES, MAX_SYNONYMS, MAX_TEXT
from service.jobs.documents import FileReference

_Front = Annotated[float, Field(ge=-360.0, le=360.0)]


class WordDocument(BaseModel):
    """What a word of one's own is to be."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    noun: str = Field(
        "",
        max_length=80,
        description="What the meshes are. Needed with meshes; a `.word` has its own.",
        examples=["dragonfruit"],
    )
    synonyms: list[Annotated[str, StringConstraints(max_length=80)]] = Field(
        default_factory=list, max_length=MAX_SYNONYMS, description="Other names for it.", examples=[["pitaya"]]
    )
    like: str = Field(
        "",
        max_length=80,
        description="A noun of ours as whose parts theirs are read. Default: what the first looks like.",
        examples=["apple"],
    )
    front: _Front | None = Field(
        None,
        description="Where all meshes face, in degrees: 0 is +Z, 90 is +X. Default: found with the parts, else +Z.",
        examples=[90],
    )
    fronts: dict[Annotated[str, StringConstraints(max_length=MAX_FILENAME)], _Front] = Field(
        default_factory=dict,
        max_length=MAX_SHAPES,
        description="Where some meshes face, by the names of their files.",
        examples=[{"fruit.glb": 180}],
    )
    licence: str = Field("", max_length=MAX_TEXT, description="Of the meshes, in a few words.", examples=["CC0"])
    replace: bool = Field(
        False, description="Whether it takes the place of your word of that noun, or of ours, for you.", examples=[True]
    )
    meshes: list[FileReference] = Field(
        default_factory=list,
        max_length=MAX_SHAPES,
        description="Stored files that are meshes of it, beside those that are sent along.",
        examples=[[{"upload_id": "upl_01kg9zqk2xf3v8c5m7n9p1r4t6"}]],
    )
