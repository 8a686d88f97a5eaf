"""The inputs of the parameter node, made from the declaration of the service's parameters, and what they ask for.

The fields are those of the web page's form. A widget of ComfyUI always has a value: `preset` in a list and -1 in a
number stand for the preset's value.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from meshdeform.requests.declaration import FORM
from meshdeform.requests.groups import grouped, plain_location
from meshdeform.requests.parameters import CommonParams, ControlParams, DeformParams, PromptGuidanceParams

__all__ = ["FROM_PRESET", "MORE", "inputs", "problem", "wanted"]

FROM_PRESET = "preset"
MORE = "more"
_UNSET = -1.0


def inputs() -> dict[str, tuple[Any, ...]]:
    """Return the widgets of the node, in the form's order."""
    widgets = {name: _widget(member) for name, member in _form().items()}
    help_more = 'Any other parameters, as a JSON object: {"control": {"symmetry": "auto", "falloff": 0.2}}'
    return {**widgets, MORE: ("STRING", {"default": "", "multiline": True, "tooltip": help_more})}


def wanted(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that the values of the widgets ask for."""
    form = _form()
    chosen = {name: _value(form[name], value) for name, value in values.items() if name in form}
    params = grouped({name: value for name, value in chosen.items() if value is not None})
    params = _with_more(params, grouped(_object(str(values.get(MORE) or ""))))
    try:
        DeformParams.model_validate(params)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in plain_location(["params", *first["loc"]])[1:])
        raise ValueError(f"{where}: {first['msg']}") from error
    return params


def _with_more(params: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of the widgets with those of the text, which must be others."""
    for name in ("preset", "seed", "kind"):
        if name in more or name in more.get("guidance", {}):
            raise ValueError(f"{MORE}: {name} is set in the node that starts the job.")
    merged = dict(params)
    for name, value in more.items():
        if name in params and not isinstance(params[name], dict):
            raise ValueError(f"{MORE}: {name} is already set above.")
        if twice := sorted(set(params.get(name, ())) & set(value)) if name in params else ():
            raise ValueError(f"{MORE}: {twice[0]} is already set above.")
        merged[name] = {**params[name], **value} if name in params else value
    return merged


def problem(values: Mapping[str, Any]) -> str | None:
    """Return what is wrong with the values of the widgets, if anything is. Values of linked inputs are None."""
    try:
        wanted(values)
    except ValueError as error:
        return str(error)
    return None


def _form() -> dict[str, dict[str, Any]]:
    members: dict[str, dict[str, Any]] = {}
    for model in (CommonParams, PromptGuidanceParams, ControlParams):
        members |= model.model_json_schema()["properties"]
    return {name: member for name, member in members.items() if FORM in member}


def _widget(member: Mapping[str, Any]) -> tuple[Any, ...]:
    form = member[FORM]
    tooltip = f"{form['label']}. {form['help']}"
    if choices := form.get("choices"):
        explained = " ".join(f"{value}: {label}." for value, label in choices)
        values = [FROM_PRESET, *(value for value, _ in choices)]
        return values, {"default": FROM_PRESET, "tooltip": f"{tooltip} {explained}"}
    kind = next((branch for branch in member.get("anyOf", [member]) if branch.get("type") != "null"), member)
    if kind["type"] == "string":
        return "STRING", {"default": "", "multiline": True, "tooltip": tooltip}
    most, tooltip = kind["maximum"], f"{tooltip} -1: the preset's value."
    if kind["type"] == "integer":
        return "INT", {"default": -1, "min": -1, "max": most, "tooltip": tooltip}
    # Without `round`, ComfyUI rounds to multiples of the step.
    step = 0.001 if most <= 1.0 else 0.1
    return "FLOAT", {"default": _UNSET, "min": _UNSET, "max": most, "step": step, "round": False, "tooltip": tooltip}


def _value(member: Mapping[str, Any], value: Any) -> Any:
    """Return a widget's value as the service takes it; None for the preset's."""
    if isinstance(value, str):
        if value in ("", FROM_PRESET):
            return None
        if "choices" in member[FORM] and value.lstrip("-").isdigit():
            return float(value)  # the front, in degrees
        return value
    return None if value == _UNSET else value


def _object(text: str) -> dict[str, Any]:
    if not text.strip():
        return {}
    try:
        document = json.loads(text)
    except ValueError as error:
        raise ValueError(f"{MORE}: this is not JSON: {error}") from error
    if not isinstance(document, dict):
        raise ValueError(f'{MORE}: write a JSON object, such as {{"control": {{"symmetry": "auto"}}}}.')  # noqa: TRY004 - a value
    return document
