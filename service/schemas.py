"""Documents that only HTTP knows; those about jobs are `meshdeform.jobs.views`."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["Health", "PartHealth", "Problem", "Readiness"]


class Problem(BaseModel):
    """An error, as RFC 9457 has it. Programs compare `code`, which is stable; more members may follow."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(description="A URN with the code.", examples=["urn:meshdeform:problem:parameter_invalid"])
    title: str = Field(
        description="The same sentence for every occurrence.", examples=["A parameter is unknown or out of range"]
    )
    status: int = Field(ge=400, le=599, description="The HTTP status.", examples=[422])
    detail: str = Field(description="About this occurrence.", examples=["params.steps: Input should be at least 1"])
    code: str = Field(description="What happened, in a word that never changes.", examples=["parameter_invalid"])
    advice: str = Field(description="What to do.", examples=["Fix the members that `errors` names."])
    instance: str = Field(description="The path that was asked for.", examples=["/v1/jobs"])
    errors: list[dict[str, Any]] | None = Field(
        None,
        description="Where parameters are wrong: the place (`loc`), what is wrong (`msg`) and its kind (`type`).",
        examples=[[{"loc": ["params", "steps"], "msg": "Input should be at least 1", "type": "greater_than_equal"}]],
    )


class Health(BaseModel):
    """The process lives."""

    status: Literal["ok"] = Field("ok", description="Always `ok`.", examples=["ok"])
    version: str = Field(description="Version of Meshdeform.", examples=["0.1.0"])


class PartHealth(BaseModel):
    """Whether one part answers."""

    status: Literal["ok", "unavailable"] = Field(description="Whether it answers.", examples=["ok"])
    detail: str = Field("", description="What is wrong, where something is.", examples=["Redis does not answer."])


class Readiness(BaseModel):
    """Whether every part answers that the service needs."""

    status: Literal["ok", "unavailable"] = Field(description="`ok` when every part is.", examples=["ok"])
    record: PartHealth = Field(description="The database.")
    redis: PartHealth = Field(description="The queue.")
    store: PartHealth = Field(description="The object store.")
