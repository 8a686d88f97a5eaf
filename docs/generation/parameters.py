"""Write docs/parameters.md: every parameter with its default, bounds and presets."""

from __future__ import annotations

import textwrap
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from meshdeform.requests.control import Handle, Region
from meshdeform.requests.document import (
    DeformParams,
    GuidanceKind,
    JobRequest,
    OutputOptions,
    Preset,
    ResolvedParams,
    resolve,
)
from meshdeform.requests.parameters import CONSTANTS, FROM_PRESET
from meshdeform.requests.rigid import RigidSelector
from meshdeform.requests.selection import Box, Capsule, ColorRange, JointWeight, Selection, Sphere

FAMILIES = {
    "builtin": {"guidance": GuidanceKind.SDS, "model": "builtin"},
    "Stable Diffusion": {"guidance": GuidanceKind.SDS, "model": "any/other"},
    "target": {"guidance": GuidanceKind.TARGET},
}
_BOUNDS = {
    "minimum": "at least",
    "exclusiveMinimum": "above",
    "maximum": "at most",
    "exclusiveMaximum": "below",
    "minLength": "length at least",
    "maxLength": "length at most",
    "maxProperties": "entries at most",
    "maxItems": "entries at most",
}
# Parameters without a meaning for a target mesh.
_OF_SDS = {"appearance", "guidance_scale", "guidance_rescale", "timestep_min", "timestep_max", "timestep_max_end"}

INTRODUCTION = """\
# Parameters

This page is generated from `meshdeform/requests/` by `python docs/generate.py`.

A job is described by one JSON document: the part `request` of `POST /v1/jobs`. Every member is optional, except the
prompt of a job that is guided by one. Unknown members are refused.

```json
{"kind": "text_deform", "prompt": "a mushroom", "params": {"preset": "preview", "seed": 7}, "output": {"morph": true}}
```
"""

PRESETS = """\
## Presets

A preset provides the parameters that were left out, and the constants that no request has: those of the cameras
(`elevation_...`, `fov_...`, `framing...`), `guidance_weight`, `guidance_rescale`, `timestep_max...` and `stiffness`.
Its values depend on what guides the job: the builtin demonstration prior, a Stable Diffusion model, or a target mesh.
`paper` has the published values; the builtin prior needs its own guidance scale.
"""


SELECTION = """\
The members of an entry of `params.rigid` or `params.regions` that say where; exactly one is set. Coordinates are those
of the file in world space, with +Y up, as `meshdeform inspect` lists them. A triangle is within a shape if all its
corners are.
"""


def wrapped(text: str) -> str:
    """Wrap a text to lines of at most 118 characters."""
    return textwrap.fill(text, 118, break_on_hyphens=False, break_long_words=False)


def bounds(schema: dict[str, Any]) -> str:
    """Return the bounds in a member's JSON schema, in words."""
    stated = schema | next((kind for kind in schema.get("anyOf", []) if kind.get("type") != "null"), {})
    return ", ".join(f"{words} {stated[name]:,}" for name, words in _BOUNDS.items() if name in stated)


def default(field: FieldInfo) -> str:
    """Return a field's default in words."""
    if field.is_required():
        return "none, it is required"
    value: Any = field.get_default(call_default_factory=True) if field.default_factory is None else None
    if isinstance(value, BaseModel):
        return f"`{value.model_dump_json()}`"
    if value is None or value == ():
        return "none" if field.default_factory is None else "empty"
    return "empty" if value == "" else f"`{str(value).lower() if isinstance(value, bool) else value}`"


def section(model: type[BaseModel], *, prefix: str, without: tuple[str, ...] = ()) -> str:
    """Return a section for each field of a model."""
    schemas = model.model_json_schema()["properties"]
    parts = []
    for name, field in model.model_fields.items():
        if name in without:
            continue
        limits = bounds(schemas[name])
        # If the default is not a value, the description explains it.
        facts = [] if "Default:" in (field.description or "") else [f"Default: {default(field)}."]
        facts += [f"Bounds: {limits}."] if limits else []
        parts.append(f"### {prefix}{name}\n\n{wrapped(field.description or '')}\n\n{' '.join(facts)}\n")
    return "\n".join(parts)


def shown(value: float | str) -> str:
    """Format a parameter's value for a table: a number, or the name of a choice."""
    return f"`{value}`" if isinstance(value, str) else f"{value:g}"


def presets() -> str:
    """Return the table of the values of each preset for each kind of guidance."""
    columns = [(family, preset) for family in FAMILIES for preset in Preset]
    resolved = [resolve(DeformParams(preset=preset, **FAMILIES[family])) for family, preset in columns]
    optional = [name for name in ResolvedParams.model_fields if name in FROM_PRESET | CONSTANTS]
    lines = [
        "| | " + " | ".join(f"{family}, `{preset}`" for family, preset in columns) + " |",
        "|---" * (len(columns) + 1) + "|",
    ]
    for name in optional:
        cells = [
            "" if name in _OF_SDS and family == "target" else shown(getattr(values, name))
            for (family, _), values in zip(columns, resolved, strict=True)
        ]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def page() -> str:
    """Return the whole page."""
    return "\n".join(
        [
            INTRODUCTION,
            PRESETS,
            presets(),
            "## The document\n",
            section(JobRequest, prefix="", without=("params", "output")),
            "## params\n",
            section(DeformParams, prefix="params."),
            "## A selection\n",
            SELECTION,
            section(Selection, prefix=""),
            section(JointWeight, prefix="joint."),
            section(ColorRange, prefix="color."),
            section(Box, prefix="box."),
            section(Sphere, prefix="sphere."),
            section(Capsule, prefix="capsule."),
            "## A rigid part\n",
            "The other members of an entry of `params.rigid`.\n",
            section(RigidSelector, prefix="params.rigid[].", without=tuple(Selection.model_fields)),
            "## A region\n",
            "The other member of an entry of `params.regions`.\n",
            section(Region, prefix="params.regions[].", without=tuple(Selection.model_fields)),
            "## A handle\n",
            section(Handle, prefix="params.handles[]."),
            "## output\n",
            section(OutputOptions, prefix="output."),
        ]
    )
