"""Declare what guides a job beside its one prompt: more prompts, or stages. Torch-free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.selection import MAX_SELECTORS, Selection
from meshdeform.requests.strict import StrictModel

if TYPE_CHECKING:
    from meshdeform.requests.parameters import DeformParams

__all__ = [
    "MAX_PROMPTS",
    "MAX_STAGES",
    "PROMPTS",
    "STAGES",
    "TARGET_PARTS",
    "Prompt",
    "Stage",
    "StageProgress",
    "active_prompts",
    "contradicted",
    "goal_guidance",
    "named_targets",
    "needs_prior",
    "of_stage",
    "prompt_words",
    "stage_at",
    "stage_titles",
]


MAX_PROMPTS = 8
_MAX_LENGTH = 1_000
_MAX_WEIGHT = 100.0

_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=_MAX_LENGTH)]


class Prompt(StrictModel):
    """One of several prompts that guide at the same time."""

    prompt: _Text = Field(description="What the asset, or its region, should become.", examples=["a rabbit"])
    weight: float = Field(
        1.0,
        ge=0.0,
        le=_MAX_WEIGHT,
        description="How strongly it pulls, relative to the others; 0: not at all. `prompt` of the request has the "
        "weight 1. Where the weights add up to more than 1, they are divided by their sum.",
        examples=[0.5],
    )
    regions: tuple[Selection, ...] = Field(
        (),
        max_length=MAX_SELECTORS,
        description="The parts of the surface that it pulls at. Default: everything.",
        examples=[[{"box": {"min": [-1.0, 1.0, -1.0], "max": [1.0, 2.0, 1.0]}}]],
    )
    outside: bool = Field(False, description="Pull at everything outside of `regions` instead.", examples=[False])

    @model_validator(mode="after")
    def _outside_of_something(self) -> Self:
        if self.outside and not self.regions:
            raise ValueError("outside needs regions")
        return self


PROMPTS: Any = Field(
    (),
    max_length=MAX_PROMPTS,
    description="Further prompts that guide at the same time as `prompt` of the request, each with a weight and, if it "
    "has one, a region. Without `prompt`, they are all there are ([Control](control.md#several-prompts)).",
    examples=[[{"prompt": "a rabbit", "weight": 0.5}]],
)


def active_prompts(prompt: str, prompts: tuple[Prompt, ...]) -> list[Prompt]:
    """Return the prompts that pull at anything, that of the request first; there may be none."""
    found = [Prompt(prompt=prompt)] if prompt else []
    return [*found, *(each for each in prompts if each.weight > 0)]


def prompt_words(prompt: str, params: Any) -> str:
    """Return all prompts of a job in one line; parameters of another kind of job have none of their own."""
    # A client keeps parameters of a later service as they came.
    prompts = [each if isinstance(each, Mapping) else vars(each) for each in getattr(params, "prompts", ())]
    further = [each.get("prompt", "") for each in prompts]
    return " + ".join(dict.fromkeys(text for text in (prompt, *further) if text))


def contradicted(params: DeformParams, guidance: GuidanceKind) -> tuple[str, str] | None:
    """Return what further prompts cannot be combined with, and why; None if there is nothing."""
    if not params.prompts:
        return None
    if params.stages:
        return "stages", "each stage has one prompt of its own"
    if guidance is not GuidanceKind.SDS:
        return "guidance", f"`{guidance}` uses no prompt"
    return None


MAX_STAGES = 8
TARGET_PARTS = ("target", *(f"target_{number}" for number in range(2, MAX_STAGES + 1)))
"""The parts of a job that are target meshes."""

_MAX_PROMPT = 1_000

_Prompt = Annotated[str, StringConstraints(strip_whitespace=True, max_length=_MAX_PROMPT)]
_TargetPart = Annotated[str, StringConstraints(strict=True, pattern=r"^target(_[2-8])?$")]


class Stage(StrictModel):
    """One of several goals in a row: a prompt or a target."""

    prompt: _Prompt = Field("", description="What the asset becomes in this stage.", examples=["a pear"])
    target: _TargetPart | None = Field(
        None,
        description="Instead of a prompt, the part that is this stage's target mesh: `target`, `target_2` up to "
        "`target_8`.",
        examples=["target"],
    )
    name: Annotated[_Prompt, StringConstraints(max_length=100)] = Field(
        "", description="Its name in `morph.glb` and in the progress. Default: the prompt, or the name of the target."
    )

    @model_validator(mode="after")
    def _one(self) -> Self:
        if bool(self.prompt) == (self.target is not None):
            raise ValueError("a stage has either a prompt or a target")
        return self

    @property
    def guidance(self) -> GuidanceKind:
        """What guides this stage."""
        return GuidanceKind.SDS if self.target is None else GuidanceKind.TARGET

    @property
    def title(self) -> str:
        """Its name, else its prompt, else that of its target."""
        return self.name or self.prompt or self.target or ""


class StageProgress(BaseModel):
    """The stage in which a job is."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    number: int = Field(ge=1, description="From 1.", examples=[2])
    count: int = Field(ge=1, description="Number of stages.", examples=[3])
    name: str = Field(description="Its name.", examples=["a mushroom"])


STAGES: Any = Field(
    (),
    max_length=MAX_STAGES,
    description="Several prompts or targets in a row, each beginning where the last one ended, with `steps` steps "
    "each. They replace the prompt and `guidance`, and the job also writes `morph.glb` ([Control](control.md)).",
    examples=[[{"prompt": "a pear"}, {"prompt": "a mushroom"}]],
)


def stage_titles(document: Mapping[str, Any]) -> list[str]:
    """Return the titles of the stages of a stored request, even if a later version wrote it; most have no stages."""
    params = document.get("params")
    stages = params.get("stages") if isinstance(params, Mapping) else None
    return [_title(stage) for stage in stages] if isinstance(stages, list) else []


def _title(stage: Any) -> str:
    if not isinstance(stage, Mapping):
        return ""
    return str(stage.get("name") or stage.get("prompt") or stage.get("target") or "")


def stage_at(titles: Sequence[str], step: int, total_steps: int) -> StageProgress | None:
    """Return the stage of a job of which `step` steps are done; None if it has no stages."""
    if not titles:
        return None
    each = max(total_steps // len(titles), 1)
    index = min(step // each, len(titles) - 1)
    return StageProgress(number=index + 1, count=len(titles), name=titles[index])


def of_stage(params: DeformParams, stage: Stage) -> DeformParams:
    """Return the parameters as written, for one stage."""
    return params.model_copy(update={"guidance": stage.guidance, "stages": (), "sketch": None})


def goal_guidance(params: DeformParams) -> GuidanceKind:
    """Return what guides the first stage, or the only one."""
    if params.stages:
        return params.stages[0].guidance
    return params.guidance if params.sketch is None else GuidanceKind.TARGET


def needs_prior(params: DeformParams) -> bool:
    """Return whether a prompt guides any stage."""
    if params.stages:
        return any(stage.guidance is GuidanceKind.SDS for stage in params.stages)
    return goal_guidance(params) is GuidanceKind.SDS


def named_targets(params: DeformParams) -> tuple[str, ...]:
    """Return the parts that a request needs as target meshes."""
    if params.stages:
        return tuple(dict.fromkeys(stage.target for stage in params.stages if stage.target is not None))
    return ("target",) if params.guidance is GuidanceKind.TARGET and params.sketch is None else ()
