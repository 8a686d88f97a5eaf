"""Write docs/parameters.md: every parameter with its default, bounds and presets."""

from __future__ import annotations

import re
import textwrap
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from meshdeform.requests.document import (
    DeformParams,
    GuidanceKind,
    JobRequest,
    OutputParams,
    Preset,
    ResolvedParams,
    resolve,
)
from meshdeform.requests.groups import GROUPS
from meshdeform.requests.parameters import (
    CONSTANTS,
    FROM_PRESET,
    ControlParams,
    ExemplarGuidanceParams,
    InputParams,
    PromptGuidanceParams,
    SilhouetteGuidanceParams,
    TargetGuidanceParams,
)
from meshdeform.requests.selection import (
    BoxParams,
    CapsuleParams,
    ColorParams,
    HandleParams,
    JointParams,
    RegionParams,
    RigidParams,
    SelectionParams,
    SphereParams,
)

FAMILIES: dict[str, dict[str, Any]] = {
    "builtin": {"kind": GuidanceKind.SDS, "model": "builtin"},
    "Stable Diffusion": {"kind": GuidanceKind.SDS, "model": "any/other"},
    "target": {"kind": GuidanceKind.TARGET},
    "pictures": {"kind": GuidanceKind.SILHOUETTES},
}
"""What has values of its own in a preset; `exemplar` guidance has none but `orientation`, that of `builtin`."""
_GUIDANCE = "params.guidance."
_BOUNDS = {"minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most", "exclusiveMaximum": "below"}
_COUNTS = (
    ("minLength", "maxLength", "characters"),
    ("minItems", "maxItems", "entries"),
    ("minProperties", "maxProperties", "entries"),
)
_OF_OTHERS = ("kind", *PromptGuidanceParams.model_fields, *TargetGuidanceParams.model_fields)
# Constants that have a meaning for a prompt alone.
_OF_SDS = {"guidance_rescale", "timestep_max", "timestep_max_end"}

INTRODUCTION = """\
# Parameters

A job is described by one JSON document: the field `request` of `POST /v1/jobs`. Every member is optional, except the
prompt of a job that is guided by one. Unknown members are refused. (`python docs/generate.py` writes this page.)

```json
{"kind": "text_deform", "prompt": "a mushroom", "params": {"seed": 7}, "output": {"morph": true}}
```

The group `params.guidance`, whose members depend on its `kind`, says what guides the deformation; `params.control`
says what may move:

```json
{"prompt": "a dog", "params": {"guidance": {"orientation": "auto"}, "control": {"regions": [{"node": "Head"}]}}}
```

Every name is unique. The command line takes it with its group or without (`--set orientation=auto`); the answer of
`POST /v1/jobs:validate` and `report.json` list all values without groups, with `guidance` as its kind alone.
"""

GUIDANCE = """\
## params.guidance

An object whose `kind` says what guides the deformation:

"""

WHICH = """\
A parameter of another kind is refused.

### Which kind

A request need not name the kind. It is then decided once, when the job is accepted, and the job names it: the first of
these that has every parameter that was sent.

- with target meshes: `target` for one, `exemplar` for several
- with pictures and without a prompt: `silhouettes`
- with a prompt: `exemplar`, then `sds`; the other way round where the operator has named a model (MESHDEFORM_MODEL)
- for whatever has none of these: `sds`

So `preset`, `steps` and the other parameters of the optimiser, `model`, `negative_prompt` and whatever else only a
model has mean `sds` beside a prompt. A branch without a kind has that of its job.
"""

KINDS = {
    GuidanceKind.SDS: ("a diffusion model and the prompt", "Guidance by a prompt"),
    GuidanceKind.TARGET: ("a second mesh, sent as the field `target`", "Guidance by a target mesh"),
    GuidanceKind.SILHOUETTES: ("pictures alone, without a prompt", "Guidance by pictures"),
    GuidanceKind.EXEMPLAR: ("what the prompt's noun stands for", "Guidance by an exemplar"),
}

PROMPT = """\
`params.guidance` of the kind `sds`:

```json
{"prompt": "a dog", "params": {"preset": "preview", "guidance": {"kind": "sds"}}}
```

Pictures can guide beside the prompt: `silhouettes` and `silhouette_weight` are
those of [guidance by pictures](#guidance-by-pictures).
"""

TARGET = """\
`params.guidance` of the kind `target`:

```json
{"params": {"guidance": {"kind": "target", "align": "none"}}}
```
"""

PICTURES = """\
`params.guidance` of the kind `silhouettes`, or of `exemplar` or `sds` beside a prompt:

```json
{"params": {"guidance": {"kind": "silhouettes", "silhouettes": [{"azimuth": 0}, {"azimuth": 90}]}}}
```
"""

EXEMPLAR = """\
`params.guidance` of the kind `exemplar` ([A word is a shape](exemplar.md)):

```json
{"prompt": "a giraffe", "params": {"guidance": {"strength": 0.9}}}
```

`prompts`, `orientation` and `source_noun` are those of [guidance by a prompt](#guidance-by-a-prompt), `align` and
`landmarks` those of [guidance by a target mesh](#guidance-by-a-target-mesh), `silhouettes` those of
[guidance by pictures](#guidance-by-pictures). The settings of the optimiser (`steps`, `learning_rate`, `carrier`,
`safeguard` and the weights) are refused, and a preset has nothing to fill in.
"""

PRESETS = """\
## Presets

A preset provides the parameters that were left out, and constants that no request has: the cameras, `guidance_weight`,
`guidance_rescale`, `timestep_max...` and `stiffness`. Its values depend on what guides the job. Each cell has those of
`preview` and `balanced`, or one for both, and after a semicolon that of `paper`, the published value, where it differs.
"""


SELECTION = """\
The members of an entry of `params.control.rigid` or `params.control.regions` that say where; exactly one is set.
Coordinates are those of the file in world space, with +Y up, as `meshdeform inspect` lists them. A triangle is within a
shape if all its corners are.
"""


def meaning(field: FieldInfo) -> str:
    """Return a field's description without the values that the table of presets has."""
    return re.sub(r" Default: the preset's\. Paper: \S+\.$", "", field.description or "")


def wrapped(text: str) -> str:
    """Wrap a text to lines of at most 118 characters."""
    return textwrap.fill(text, 118, break_on_hyphens=False, break_long_words=False)


def bounds(schema: dict[str, Any]) -> str:
    """Return the bounds in a member's JSON schema, in words."""
    stated = schema | next((kind for kind in schema.get("anyOf", []) if kind.get("type") != "null"), {})
    both = {"minimum", "maximum"} <= stated.keys()
    parts = [f"from {_number(stated['minimum'])} to {_number(stated['maximum'])}"] if both else []
    names = [name for name in _BOUNDS if name in stated and not (both and name in ("minimum", "maximum"))]
    parts += [f"{_BOUNDS[name]} {_number(stated[name])}" for name in names]
    for least, most, what in _COUNTS:
        if most in stated and stated.get(least) != stated[most]:  # of a place in space nobody needs to hear "3"
            low = f"{_number(stated[least])} to" if stated.get(least) else "at most"
            parts.append(f"{low} {_number(stated[most])} {what}")
    return ", ".join(parts)


def _number(value: float) -> str:
    return f"{int(value):,}" if value == int(value) else f"{value:g}"


def default(field: FieldInfo) -> str:
    """Return a field's default in words."""
    value: Any = field.get_default(call_default_factory=True) if field.default_factory is None else None
    if isinstance(value, BaseModel):
        return f"`{value.model_dump_json()}`"
    if value is None or value == ():
        return "none" if field.default_factory is None else "empty"
    return "empty" if value == "" else f"`{str(value).lower() if isinstance(value, bool) else value}`"


def facts(field: FieldInfo, schema: dict[str, Any]) -> str:
    """Return the default and the bounds of a field, as far as its description does not say them."""
    limits, value = bounds(schema), default(field)
    told = "Default:" in (field.description or "") or value == "none"
    start = "Required." if field.is_required() else "" if told else f"Default: {value}."
    return " ".join(part for part in (start, f"{limits[0].upper()}{limits[1:]}." if limits else "") if part)


def section(model: type[BaseModel], *, prefix: str, without: tuple[str, ...] = ()) -> str:
    """Return a section for each field of a model."""
    schemas = model.model_json_schema()["properties"]
    parts = []
    for name, field in model.model_fields.items():
        if name not in without:
            told = facts(field, schemas[name])
            parts.append(f"### {prefix}{name}\n\n{wrapped(meaning(field))}\n" + (f"\n{told}\n" if told else ""))
    return "\n".join(parts)


def listed(*models: tuple[str, type[BaseModel]], without: tuple[str, ...] = ()) -> str:
    """Return a list of the fields of models, each with the beginning of its names."""
    lines = []
    for prefix, model in models:
        schemas = model.model_json_schema()["properties"]
        for name, field in model.model_fields.items():
            if name not in without:
                told = f"{field.description} {facts(field, schemas[name])}"
                lines.append(f"- `{prefix}{name}`: {' '.join(told.split())}")
    return "\n".join(lines) + "\n"


def shown(value: float | str) -> str:
    """Format a parameter's value for a table: a number, or the name of a choice."""
    return f"`{value}`" if isinstance(value, str) else f"{value:g}"


def is_used(name: str, guidance: GuidanceKind) -> bool:
    """Return whether a parameter or constant has a meaning for a kind of guidance."""
    kinds = GROUPS[name][1] if name in GROUPS else ()
    return guidance in kinds if kinds else guidance is GuidanceKind.SDS or name not in _OF_SDS


def presets() -> str:
    """Return the table of the values of each preset for each kind of guidance, and what all have in common."""
    lines = ["| | " + " | ".join(FAMILIES) + " |", "|---" * (len(FAMILIES) + 1) + "|"]
    common = []
    for name in (name for name in ResolvedParams.model_fields if name in FROM_PRESET | CONSTANTS):
        cells = [cell(name, family) for family in FAMILIES]
        if len(set(cells)) == 1 and ";" not in cells[0]:
            common.append(f"`{name}` {cells[0]}")
        else:
            lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    same = wrapped(f"All have {', '.join(common)}.")
    return "\n".join(lines) + f"\n\n{same}\n"


def cell(name: str, family: str) -> str:
    """Return the values of a parameter or constant in a family's presets, that of `paper` where it differs."""
    made = [resolve(DeformParams.model_validate({"preset": each, "guidance": FAMILIES[family]})) for each in Preset]
    if not is_used(name, made[0].guidance):
        return ""
    values = {preset: shown(getattr(each, name)) for preset, each in zip(Preset, made, strict=True)}
    ours = ", ".join(dict.fromkeys(values[each] for each in (Preset.PREVIEW, Preset.BALANCED)))
    return ours if ours == values[Preset.PAPER] else f"{ours}; {values[Preset.PAPER]}"


def guidances() -> str:
    """Return the list of the kinds of guidance with the parameters of each."""
    lines = []
    for kind, (what, title) in KINDS.items():
        names = ", ".join(f"`{name}`" for name, (_, kinds) in GROUPS.items() if kind in kinds)
        anchor = title.lower().replace(" ", "-")
        lines.append(f"- `{kind}`: [{what}](#{anchor}), with {names}")
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
            section(DeformParams, prefix="params.", without=("guidance", "control", "input")),
            GUIDANCE + guidances(),
            WHICH,
            "## Guidance by a prompt\n",
            PROMPT,
            section(PromptGuidanceParams, prefix=_GUIDANCE, without=("kind", *SilhouetteGuidanceParams.model_fields)),
            "## Guidance by a target mesh\n",
            TARGET,
            section(TargetGuidanceParams, prefix=_GUIDANCE, without=("kind",)),
            "## Guidance by pictures\n",
            PICTURES,
            section(SilhouetteGuidanceParams, prefix=_GUIDANCE, without=("kind",)),
            "## Guidance by an exemplar\n",
            EXEMPLAR,
            section(ExemplarGuidanceParams, prefix=_GUIDANCE, without=_OF_OTHERS),
            "## params.control\n",
            "What may move, and what the result keeps, with any guidance ([Control](control.md)).\n",
            section(ControlParams, prefix="params.control."),
            "## params.input\n",
            "How the asset's file is to be read, with any guidance.\n",
            section(InputParams, prefix="params.input."),
            "## A selection\n",
            SELECTION,
            listed(
                ("", SelectionParams),
                ("joint.", JointParams),
                ("color.", ColorParams),
                ("box.", BoxParams),
                ("sphere.", SphereParams),
                ("capsule.", CapsuleParams),
            ),
            "## A rigid part\n",
            "The other members of an entry of `params.control.rigid`.\n",
            listed(("", RigidParams), without=tuple(SelectionParams.model_fields)),
            "## A region\n",
            "The other member of an entry of `params.control.regions`.\n",
            listed(("", RegionParams), without=tuple(SelectionParams.model_fields)),
            "## A handle\n",
            "The members of an entry of `params.control.handles`.\n",
            listed(("", HandleParams)),
            "## output\n",
            section(OutputParams, prefix="output."),
        ]
    )
