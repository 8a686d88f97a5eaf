"""Declare documents of a request, parameters whose default is the preset's, and what the page shows. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

FORM = "x-form"
"""Schema member that describes a field of the page's form: `label`, `help`, and `choices` as pairs of value and label.
The form shows the parameters that have it."""

OF_PRESET = "x-of-preset"
"""Schema member that marks a parameter whose default comes from the preset."""

_ABOUT = frozenset({"title", "description", "examples", FORM})
"""Members of a schema that do not constrain values."""


class StrictModel(BaseModel):
    """An immutable document that refuses unknown members."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def of_preset(paper: float | StrEnum, description: str, *, form: Mapping[str, Any] | None = None, **bounds: Any) -> Any:
    """Declare a parameter whose default comes from the preset.

    `paper`: the paper's value, used by presets that do not override it; `form`: the value of `FORM`, for parameters
    shown in the form. `**bounds`: arguments of pydantic's `Field`; the default of `examples` is the paper's value.
    """
    shown = f"`{paper}`" if isinstance(paper, StrEnum) else f"{paper:g}"
    extra: dict[str, Any] = {OF_PRESET: True, **({FORM: dict(form)} if form else {})}
    return Field(
        paper,
        description=f"{description} Default: the preset's. Paper: {shown}.",
        json_schema_extra=extra,
        **{"examples": [paper], **bounds},
    )


def nullable(member: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a member that may also be null."""
    kind = {key: value for key, value in member.items() if key not in _ABOUT}
    about = {key: value for key, value in member.items() if key in _ABOUT}
    return {"anyOf": [*kind.get("anyOf", [kind]), {"type": "null"}], **about}
