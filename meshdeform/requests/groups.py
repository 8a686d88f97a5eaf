"""Say in which group of a request each parameter is, and put those that are named alone in theirs. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel

from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.parameters import GUIDANCES, OPEN, CommonParams, ControlParams, InputParams, OpenGuidanceParams
from meshdeform.requests.problems import did_you_mean, reason

GROUPS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    **dict.fromkeys(CommonParams.model_fields, ("", ())),
    **dict.fromkeys(ControlParams.model_fields, ("control", ())),
    **dict.fromkeys(InputParams.model_fields, ("input", ())),
    **{
        name: ("guidance", tuple(kind for kind, other in GUIDANCES.items() if name in other.model_fields))
        for group in GUIDANCES.values()
        for name in group.model_fields
        if name != "kind"
    },
}
"""The group of each parameter, empty for those that are in none, and for `guidance` the kinds that have it."""

_TAGS: dict[str, type[BaseModel]] = {
    **{kind.value: model for kind, model in GUIDANCES.items()},
    OPEN: OpenGuidanceParams,
}
"""What pydantic adds to the path of guidance, and the model of each."""


def plain_location(location: Sequence[Any]) -> list[Any]:
    """Return a location in a request without the kind of guidance, which pydantic adds to that of a union's member."""
    tagged = list(location[:2]) == ["params", "guidance"] and location[2:3] and location[2] in _TAGS
    return [*location[:2], *location[3:]] if tagged else list(location)


def elsewhere(location: Sequence[Any]) -> str | None:
    """Return where a parameter is that was looked for at this location; None if there is none of this name."""
    path = plain_location(location)
    name = str(path[-1])
    if path[0] != "params" or len(path) > 3 or name not in GROUPS:
        return None
    group, kinds = GROUPS[name]
    place_now = f"it is params.{group}.{name}" if group else f"it is params.{name}"
    if group != "guidance":
        return f"{place_now}."
    others = "".join(f"{kind}, " for kind in kinds[:-2])
    there = f"{place_now}, where the guidance is {others}{' or '.join(kinds[-2:])}."
    return f"{there} Leave it out, or the kind, or set params.guidance.kind." if path[1] == group else there


def grouped(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with each in its group; what is in one already stays there.

    `params`: parameters by their names alone, and `guidance` by its kind, as the command line takes them. Unknown names
    stay where they are.
    """
    kind = params.get("guidance")
    groups: dict[str, dict[str, Any]] = {
        "guidance": {},
        **{name: dict(params.get(name) or {}) for name in ("control", "input")},
    }
    if kind is not None:
        groups["guidance"] = dict(kind) if isinstance(kind, Mapping) else {"kind": kind}
    rest: dict[str, Any] = {}
    for name, value in params.items():
        if name not in groups:
            group = GROUPS.get(name, ("", ()))[0]
            (groups[group] if group else rest)[name] = value
    return {**rest, **{name: group for name, group in groups.items() if group}}


def without_unused(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return grouped parameters without those that only another kind of guidance has."""
    guidance = params.get("guidance")
    kind = guidance.get("kind") if isinstance(guidance, Mapping) else None
    if not isinstance(guidance, Mapping) or kind not in list(GuidanceKind):
        return dict(params)
    used = GUIDANCES[kind]
    # Unknown names are refused, not dropped.
    own = {name: value for name, value in guidance.items() if name in used.model_fields or name not in GROUPS}
    return {**params, "guidance": own}


def in_plain_words(findings: Sequence[Any], model: type[BaseModel]) -> list[dict[str, Any]]:
    """Return pydantic's findings about a document in plain words, with what to use in location of what is unknown.

    What was written is not in them.
    """
    return [
        {
            "loc": plain_location(finding["loc"]),
            "msg": _unknown(finding["loc"], model) if finding["type"] == "extra_forbidden" else reason(finding),
            "type": finding["type"],
        }
        for finding in findings
    ]


def _unknown(location: Sequence[Any], model: type[BaseModel]) -> str:
    if advice := elsewhere(location):
        return advice
    inner: type[BaseModel] | None = model
    for step in location[:-1]:
        inner = _TAGS[step] if step in _TAGS else _model_of(inner, step) if inner is not None else None
    return did_you_mean(str(location[-1]), inner.model_fields if inner is not None else ())


def _model_of(model: type[BaseModel], name: Any) -> type[BaseModel] | None:
    """Return the model of a member, or None if it has none."""
    field = model.model_fields.get(name)
    choices = [field.annotation, *get_args(field.annotation)] if field is not None else []
    return next((each for each in choices if isinstance(each, type) and issubclass(each, BaseModel)), None)
