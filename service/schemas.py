"""Define the documents of the HTTP API that only people and operators read; the others are in `meshdeform.api`."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field


class Problem(BaseModel):
    """An error in the form of RFC 9457. Programs should compare `code`, which is stable; other members may be added."""

    model_config = ConfigDict(extra="allow")

    type: str = Field(description="A URN with the code.", examples=["urn:meshdeform:problem:parameter_invalid"])
    title: str = Field(
        description="The same sentence for every error with this code.",
        examples=["A parameter is unknown or out of range"],
    )
    status: int = Field(ge=400, le=599, description="The HTTP status.", examples=[422])
    detail: str = Field(description="Fault of this request.", examples=["params.steps: Input should be at least 1"])
    code: str = Field(description="A stable name of the error.", examples=["parameter_invalid"])
    advice: str = Field(description="Advice.", examples=["Fix the members that `errors` names."])
    instance: str = Field(description="The path of the request.", examples=["/v1/jobs"])
    request_id: str | None = Field(
        None,
        description="The request's id, also in the header `X-Request-ID` and in the server's log.",
        examples=["req_01kg9zqk2xf3v8c5m7n9p1r4t6"],
    )
    errors: list[dict[str, Any]] | None = Field(
        None,
        description="Invalid members: their place (`loc`), what is wrong (`msg`), and the kind of error (`type`).",
        examples=[[{"loc": ["params", "steps"], "msg": "Input should be at least 1", "type": "greater_than_equal"}]],
    )


class Health(BaseModel):
    """The liveness of the process."""

    status: Literal["ok"] = Field("ok", description="Always `ok`.", examples=["ok"])
    version: str = Field(description="Version of Meshdeform.", examples=["0.1.0"])


class PartHealth(BaseModel):
    """The availability of one dependency."""

    status: Literal["ok", "unavailable"] = Field(description="`ok` if it responds.", examples=["ok"])
    detail: str = Field("", description="Fault; empty if there is none.", examples=["Redis does not respond."])


class Readiness(BaseModel):
    """The availability of everything that the service needs."""

    status: Literal["ok", "unavailable"] = Field(description="`ok` if all of them are.", examples=["ok"])
    record: PartHealth = Field(description="The database.")
    redis: PartHealth = Field(description="The queue.")
    store: PartHealth = Field(description="The object store.")
