"""Declare the parameters of a deformation: name, type, bounds, meaning and the paper's value. Torch-free.

`DeformParams` holds what a user wrote: only the members in `model_fields_set` count, the others have the paper's
values. `meshdeform.requests.document` fills in those of the preset and returns a `ResolvedParams`. The page's form, the
completion of the command line and docs/parameters.md are generated from this declaration.

Source of the paper's values: Xu et al. 2024, FusionDeformer, section 4 and its public configuration.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    StringConstraints,
    Tag,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from meshdeform.requests.choices import (
    BUILTIN_MODEL,
    AlignMode,
    AppearanceMode,
    BackdropMode,
    Carrier,
    GuidanceKind,
    LengthUnit,
    OrientationMode,
    Preset,
    Safeguard,
    StartMode,
    Symmetry,
    UpAxis,
)
from meshdeform.requests.declaration import FORM, OF_PRESET, StrictModel, nullable, of_preset
from meshdeform.requests.problems import did_you_mean
from meshdeform.requests.selection import (
    MAX_HANDLES,
    MAX_LANDMARKS,
    MAX_SELECTORS,
    HandleParams,
    LandmarkParams,
    Part,
    PartParams,
    RegionParams,
    RigidParams,
    SelectionParams,
)

MAX_PROMPTS = 8

_MAX_LENGTH = 1_000

_MAX_PROMPT_WEIGHT = 100.0

_Noun = Annotated[str, StringConstraints(pattern=r"^[a-z]+(-[a-z]+)*$", max_length=40)]
_Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=_MAX_LENGTH)]


MAX_STEPS = 50_000
MAX_SEED = 2**63 - 1

MAX_PROMPT_LENGTH = 1_000

MAX_SILHOUETTES = 4

SILHOUETTE_FIELDS = tuple(f"silhouette_{number}" for number in range(1, MAX_SILHOUETTES + 1))
"""The fields of the pictures."""

MAX_TARGETS = 8

TARGET_FIELDS = ("target", *(f"target_{number}" for number in range(2, MAX_TARGETS + 1)))
"""The fields of target meshes; `target` guidance has the first alone."""

MAX_WORDS = 8
"""Words of somebody's own that one request can name."""

WORDS_FIELD = "words"
"""The field with the content of words of one's own."""

_MAX_WEIGHT = 1e6

_AS_GUIDANCE: dict[str, Any] = {"x-option": "guidance"}  # `kind` is that of the job
OPEN = "open"
"""The tag of guidance without a kind."""


class WeightedPromptParams(StrictModel):
    """One of several prompts that guide at the same time."""

    prompt: _Text = Field(description="New shape of the asset, or of its region.", examples=["a rabbit"])
    weight: float = Field(
        1.0,
        ge=0.0,
        le=_MAX_PROMPT_WEIGHT,
        description="How strongly it pulls, relative to the others; 0: not at all. `prompt` of the request has the "
        "weight 1. Where the weights add up to more than 1, they are divided by their sum.",
        examples=[0.5],
    )
    regions: tuple[SelectionParams, ...] = Field(
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


def active_prompts(prompt: str, prompts: tuple[WeightedPromptParams, ...]) -> list[WeightedPromptParams]:
    """Return the prompts that pull at anything, that of the request first; there may be none."""
    active = [WeightedPromptParams(prompt=prompt)] if prompt else []
    return [*active, *(each for each in prompts if each.weight > 0)]


def prompt_words(prompt: str, params: Any) -> str:
    """Return all prompts of a job in one line; parameters of another kind of job have none of their own."""
    # A client keeps parameters of a later service as they came, in whatever form that writes them.
    prompts = getattr(params, "prompts", ())
    further = [each.get("prompt") if isinstance(each, Mapping) else getattr(each, "prompt", "") for each in prompts]
    return " + ".join(dict.fromkeys(text for text in (prompt, *further) if text))


class Parameters(StrictModel):
    """A group of parameters as a user writes them: what was left out is not dumped, and may be null."""

    @model_validator(mode="before")
    @classmethod
    def _null_is_left_out(cls, data: Any) -> Any:
        # Clients and stored requests may have null for what comes from the preset or from the server.
        if not isinstance(data, Mapping):
            return data
        return {k: v for k, v in data.items() if v is not None or not (k == "model" or _is_of_preset(cls, k))}

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler):  # type: ignore[no-untyped-def]
        # No return annotation: pydantic would use it as JSON schema. Missing members come from the preset.
        return {name: value for name, value in handler(self).items() if name in self.model_fields_set}

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Omit the default of parameters that come from the preset, and allow null."""
        members = handler.resolve_ref_schema(schema := handler(core_schema))["properties"]
        for name, member in members.items():
            if member.pop(OF_PRESET, False):
                member.pop("default", None)
                members[name] = member if issubclass(cls, ResolvedParams) else nullable(member)
        return schema


def _is_of_preset(model: type[BaseModel], name: str) -> bool:
    """Return whether the default of a parameter comes from the preset."""
    field = model.model_fields.get(name)
    return field is not None and isinstance(field.json_schema_extra, dict) and OF_PRESET in field.json_schema_extra


class CommonParams(Parameters):
    """The parameters of every deformation."""

    preset: Preset = Field(
        Preset.BALANCED,
        description="The set of parameters that fills in everything left out: `preview` (few steps), `balanced`, or "
        "`paper` (as published).",
        examples=["preview"],
    )
    steps: int = of_preset(
        5000,
        "Optimiser iterations.",
        ge=1,
        le=MAX_STEPS,
        examples=[300],
        form={"label": "Steps", "help": "Optimiser iterations."},
    )
    seed: int = Field(
        0,
        ge=0,
        le=MAX_SEED,
        description="Seed of every random draw (cameras, timesteps, noise), and with `exemplar` of the design that is "
        "taken. The same seed gives the same result on the same machine on the CPU.",
        examples=[0],
    )
    learning_rate: float = of_preset(
        0.0025,
        "Adam's step size on the Jacobians.",
        gt=0.0,
        le=1.0,
        form={"label": "Learning rate", "help": "How far one step may go. Lower is calmer and needs more steps."},
    )
    carrier: Carrier = of_preset(
        Carrier.SURFACE,
        "Carrier of the Jacobians: `surface`, the faces; `lattice`, the cells of a lattice that holds all parts "
        "together; or `auto`: the lattice if there are several connected parts or `rigid` is set, else the surface, "
        "and for a prompt few controls of either, which keep the asset's structure.",
        examples=["auto"],
        form={
            "label": "Carrier",
            "help": "Few controls keep an asset's structure; a lattice holds parts together; a surface bends most.",
            "choices": [
                ["auto", "By the asset; few controls for a prompt"],
                ["surface", "Surface"],
                ["lattice", "Lattice"],
            ],
        },
    )
    safeguard: Safeguard = of_preset(
        Safeguard.NONE,
        "Defects that no step may cause: `intersections` (neither flipped faces nor new self-intersections), `flips`, "
        "or `none`. Where a step would cause one, it is undone locally.",
        examples=["intersections"],
        form={
            "label": "Safeguard",
            "help": "Defects that the surface must not get.",
            "choices": [
                ["intersections", "No flips, no self-intersections"],
                ["flips", "No flipped faces"],
                ["none", "Off"],
            ],
        },
    )
    jacobian_reg_weight: float = of_preset(
        0.5 / 9,  # the published 0.5 is of the mean over nine entries
        "Weight of the area-weighted mean ||J - I||^2 that keeps the asset's identity.",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[0.1],
    )
    laplacian_weight: float = of_preset(
        1e-4,
        "Weight of the Laplacian energy of the displacement (docs/method.md).",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[0.1],
    )
    normal_weight: float = of_preset(
        0.1,
        "Weight against bending between neighbouring faces (docs/method.md).",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[0.1],
        form={"label": "Smoothness", "help": "Weight against creases between neighbouring faces."},
    )
    dirichlet_weight: float = of_preset(
        0.0,
        "Weight of the symmetric Dirichlet energy, which keeps faces from collapsing (docs/method.md).",
        ge=0.0,
        le=_MAX_WEIGHT,
    )
    checkpoint_every_steps: int = Field(
        100,
        ge=1,
        le=MAX_STEPS,
        description="Steps between two checkpoints; at most this many are repeated after a crash.",
        examples=[100],
    )


OF_OPTIMISER = frozenset(CommonParams.model_fields) - {"preset", "seed", "checkpoint_every_steps"}
"""The parameters of the optimiser, which `exemplar` guidance does without."""


class ViewParams(StrictModel):
    """The direction from which a picture shows what the asset should become."""

    azimuth: float = Field(
        ge=-360.0,
        le=360.0,
        description="Azimuth in degrees: 0 sees the asset from +Z, 90 from +X, its left side.",
        examples=[90.0],
    )
    elevation: float = Field(
        0.0,
        ge=-90.0,
        le=90.0,
        description="Elevation in degrees: 0 sees it from the side, 90 from above.",
        examples=[0.0],
    )
    fov: float = Field(
        20.0,
        ge=1.0,
        le=90.0,
        description="Vertical field of view in degrees of a camera that just sees the whole object: small for a "
        "drawing or a photograph from afar, 40 for one from nearby.",
        examples=[20.0],
    )


class PictureParams(Parameters):
    """The pictures that guide."""

    silhouettes: tuple[ViewParams, ...] = Field(
        (),
        max_length=MAX_SILHOUETTES,
        description="Pictures whose silhouettes the result should have ([Control](control.md#pictures-as-targets)): "
        "the first entry describes the field `silhouette_1`, and so on.",
        examples=[[{"azimuth": 0.0}, {"azimuth": 90.0}]],
    )


class SilhouetteParams(PictureParams):
    """The parameters of pictures as targets."""

    silhouette_weight: float = of_preset(
        10.0,
        "Weight of the difference between the silhouettes.",
        ge=0.0,
        le=1e6,
        examples=[10.0],
    )


class ModelParams(Parameters):
    """A diffusion model, and how it is asked."""

    model: str | None = Field(
        None,
        min_length=1,
        max_length=500,
        description="The model of `sds`: `builtin`, a file of other weights for it (`.safetensors`), or a Stable "
        "Diffusion model by hub id or folder on the worker. Default: the server's MESHDEFORM_MODEL, else `builtin`.",
        examples=["builtin"],
    )
    guidance_scale: float = of_preset(
        100.0,
        "Classifier-free guidance s in uncond + s * (text - uncond). The built-in model needs 7.5.",
        ge=0.0,
        le=1_000.0,
        form={"label": "Guidance scale", "help": "How strongly the prompt pulls."},
    )
    negative_prompt: str = Field(
        "",
        max_length=MAX_PROMPT_LENGTH,
        description="Shapes to stay away from, in place of the empty prompt. With the built-in model: a "
        "prompt that it accepts (a chair), or attributes of the object in the prompt (fat, long neck).",
        examples=["blurry, many heads"],
        json_schema_extra={FORM: {"label": "Negative prompt", "help": "Shapes to stay away from."}},
    )


class WordParams(Parameters):
    """The parameters of prompts, whatever makes shapes of them."""

    prompts: tuple[WeightedPromptParams, ...] = Field(
        (),
        max_length=MAX_PROMPTS,
        description="Further prompts that guide at the same time, each with a weight and, if it has one, a region "
        "([Control](control.md#several-prompts)).",
        examples=[[{"prompt": "a rabbit", "weight": 0.5}]],
    )
    orientation: OrientationMode | Annotated[float, Field(ge=-360.0, le=360.0)] = of_preset(
        OrientationMode.KEEP,
        "Which side of the asset counts as its front: `auto`, the one that is the front of what the asset is read as "
        "([Parts](parts.md)); `keep`, +Z; or its azimuth in degrees, from +Z (0) towards +X (90). Only the cameras or "
        "the exemplar turn. In degrees, it is also where a change in plain words sees the front.",
        examples=["auto"],
        form={
            "label": "Front",
            "help": "The side of the asset that becomes the front of what the prompt names.",
            "choices": [
                ["auto", "Found by what the asset is"],
                ["keep", "As in the file: +Z"],
                ["90", "+X, the left side"],
                ["180", "-Z, the back"],
                ["270", "-X, the right side"],
            ],
        },
    )
    source_noun: str | None = Field(
        None,
        min_length=1,
        max_length=100,
        description="What the asset is, a noun of the builtin prior: its front and its parts are found by it, and a "
        "prompt that describes it (`a fat dog`) is a change of it. Default: recognised ([Parts](parts.md)).",
        examples=["dog"],
    )


class PromptParams(WordParams, ModelParams, SilhouetteParams):
    """The parameters of a prompt for a diffusion model, with pictures beside it if there are any."""

    appearance: AppearanceMode = of_preset(
        AppearanceMode.CLAY,
        "Pictures for the model: `clay`, grey under a varying light; `textured`, the asset's own colours under that "
        "light, so that what they show need not become shape; `mixed`, each in half of the steps; or `normals`, each "
        "face coloured by its normal, which the built-in model and targets need. An asset without colours is drawn as "
        "clay.",
        examples=["mixed"],
        form={
            "label": "Model sees",
            "help": "Look of the pictures for the model. The built-in model only knows normals.",
            "choices": [
                ["mixed", "Colours and clay in turn"],
                ["textured", "The asset's colours"],
                ["clay", "Clay"],
                ["normals", "Normals"],
            ],
        },
    )
    start: StartMode = Field(
        StartMode.ASSET,
        description="The shape from which the model starts: `asset`, as it is; or `exemplar`, the asset fitted to what "
        "the prompt's noun stands for ([A word is a shape](exemplar.md#start-a-model-from-it)).",
        examples=["exemplar"],
    )
    timestep_min: float = of_preset(
        0.02, "Lowest diffusion timestep drawn, as a fraction of T; at most the preset's highest.", ge=0.0, lt=1.0
    )


class PlacementParams(Parameters):
    """How a target mesh lies on the asset."""

    align: AlignMode = Field(
        AlignMode.AUTO,
        description="How the target is placed on the asset. `auto`: up stays up, the best turn is searched, and both "
        "get the same centre of mass and spread; `none`: both files share their coordinates.",
        examples=["auto"],
    )
    landmarks: tuple[LandmarkParams, ...] = Field(
        (),
        max_length=MAX_LANDMARKS,
        description="Points of the asset and their places on the target, which also help to find the turn.",
        examples=[[{"source": 120, "target": [0.1, 0.9, 0.5]}]],
    )


class TargetParams(PlacementParams):
    """The parameters of a target mesh."""

    point_weight: float = of_preset(
        0.0,
        "Weight of the distances between the two surfaces, relative to that of their pictures.",
        ge=0.0,
        le=_MAX_WEIGHT,
        examples=[1.0],
    )


class ExemplarParams(PlacementParams, WordParams, PictureParams):
    """The parameters of a fit to what a noun stands for, or to meshes that are sent."""

    words: dict[_Noun, _Sha256] = Field(
        {},
        max_length=MAX_WORDS,
        description="The words of your own that the prompts name, each with the SHA-256 of its content, which goes "
        "with the job ([Words](words.md)). Filled in when the job is accepted.",
        examples=[{}],
    )
    strength: float = Field(
        1.0,
        ge=0.0,
        le=1.0,
        description="How far the asset goes towards the exemplar: 1, all of the way; 0, nowhere. Less keeps more of "
        "the asset.",
        examples=[0.9],
        json_schema_extra={FORM: {"label": "Strength", "help": "How far it goes: 1 is all of the way."}},
    )


class ControlParams(Parameters):
    """Parts that may move, and properties that the result keeps."""

    regions: tuple[RegionParams, ...] = Field(
        (),
        max_length=MAX_SELECTORS,
        description="Parts of the surface that do not move, or that alone move ([Control](control.md)).",
        examples=[[{"node": "Hinge"}, {"box": {"min": [0, 1, -1], "max": [1, 2, 1]}, "action": "only"}]],
    )
    falloff: float = Field(
        0.1,
        ge=0.0,
        le=1.0,
        description="Distance along the surface over which motion begins beside what `regions` keep, and a prompt's "
        "pull within its regions, as a share of the diagonal of the asset's bounding box.",
        examples=[0.1],
    )
    handles: tuple[HandleParams, ...] = Field(
        (),
        max_length=MAX_HANDLES,
        description="Points of the surface that go to places. A large asset with handles has no simplified stand-in, "
        "which takes longer.",
        examples=[[{"position": [0, 1, 0], "to": [0, 1.5, 0]}]],
    )
    rigid: tuple[RigidParams, ...] = Field(
        (),
        max_length=MAX_SELECTORS,
        description="The parts that keep their shape, such as wheels, and move with what is around them. Needs the "
        "lattice. Bodies that share vertices become one.",
        examples=[[{"node": "wheel-front-left"}, {"material": "rubber", "mode": "similarity"}]],
    )
    symmetry: Symmetry = Field(
        Symmetry.NONE,
        description="Keep the asset's mirror symmetry: `x`, `y` or `z`, the axis to which the plane through the middle "
        "of the bounding box is perpendicular; `auto`, the first of x, z and y for which every vertex has a mirrored "
        "partner, if there is one; or `none`. A prompt keeps the mirror plane that it finds by itself "
        "(`keep_structure`).",
        examples=["auto"],
    )
    keep_structure: bool = Field(
        True,
        description="Whether a prompt with `carrier` = `auto` keeps the asset's structure: its mirror plane, of two "
        'the one in which the front lies, or both for a prompt such as "a vase", whose shape is alike from all '
        "sides; and in what is built, what is level and upright.",
        examples=[True],
    )
    exclude: tuple[Part, ...] = Field(
        (),
        max_length=MAX_SELECTORS,
        description="Nodes that are neither drawn nor deformed, with all nodes below them, such as a ground plane or a "
        "backdrop: by name (a node without a name has that of its mesh) or by index. They stay in the file as they "
        "are.",
        examples=[["Ground"]],
    )
    parts: tuple[PartParams, ...] = Field(
        (),
        max_length=MAX_SELECTORS,
        description="Corrections of the parts that are found on the asset ([Parts](parts.md#correct-it)): a part by "
        "its place, or another name for what was found. Changes in plain words and `exemplar` use them; other prompts "
        "do not.",
        examples=[
            [{"name": "ears", "box": {"min": [-1, 1, -1], "max": [1, 2, 1]}}, {"name": "ears", "parts": ["horns"]}]
        ],
    )
    backdrop: BackdropMode = Field(
        BackdropMode.LEAVE,
        description="Treatment of a flat ground or backdrop of more than four times the size of everything else: "
        "`leave`, it is neither drawn nor deformed and stays where it is; or `deform`, it is deformed with the rest. "
        "The asset's `warnings` name it.",
        examples=["leave"],
    )

    @field_validator("parts")
    @classmethod
    def _renamed_once(cls, parts: tuple[PartParams, ...]) -> tuple[PartParams, ...]:
        """Refuse two names for what was found under one."""
        renamed = [old for each in parts for old in each.parts or ()]
        if twice := sorted({old for old in renamed if renamed.count(old) > 1}):
            raise ValueError(f"what was found as {', '.join(twice)} gets a name twice")
        return parts


class InputParams(Parameters):
    """How the asset's file is to be read."""

    up: UpAxis = Field(
        UpAxis.AUTO,
        description="The axis of the file that points up: `y`, `z`, or `auto`, that of its format, or where the format "
        "leaves it open (OBJ, PLY, STL) the one with which the asset reads better, which the report tells. Changes in "
        "plain words and `exemplar` use it; the result keeps the file's axes.",
        examples=["z"],
    )
    unit: LengthUnit = Field(
        LengthUnit.AUTO,
        description="The unit of the file's numbers, for lengths in plain words: `m`, `cm`, `mm`, `in`, `ft`, or "
        "`auto`, that of its format. The result keeps the file's numbers.",
        examples=["mm"],
    )


class PromptGuidanceParams(PromptParams):
    """A diffusion model and the prompt."""

    kind: Literal["sds"] = Field(
        description="Kind of guidance, `exemplar`, `sds`, `target` or `silhouettes`; without it, by what else is sent, "
        "`exemplar` of a prompt alone.",
        examples=["sds"],
        json_schema_extra=_AS_GUIDANCE,
    )


class TargetGuidanceParams(TargetParams):
    """A second mesh, sent as the field `target`."""

    kind: Literal["target"] = Field(
        description="Kind of guidance.", examples=["target"], json_schema_extra=_AS_GUIDANCE
    )


class SilhouetteGuidanceParams(SilhouetteParams):
    """Pictures alone."""

    kind: Literal["silhouettes"] = Field(
        description="Kind of guidance.", examples=["silhouettes"], json_schema_extra=_AS_GUIDANCE
    )


class ExemplarGuidanceParams(ExemplarParams):
    """A member of the prompt's noun, or the nearest of up to eight meshes, to which the asset is fitted."""

    kind: Literal["exemplar"] = Field(
        description="Kind of guidance.", examples=["exemplar"], json_schema_extra=_AS_GUIDANCE
    )


class OpenGuidanceParams(ExemplarParams, TargetParams, PromptParams):
    """Options without a `kind`, which they, the files and the prompt decide: of a prompt alone, `exemplar`."""


def _kind_of_guidance(value: Any) -> str | None:
    """Return the kind of guidance of a value, `OPEN` of one without a kind; None if it is none."""
    if isinstance(value, OpenGuidanceParams):
        return OPEN
    kind = value.get("kind", OPEN) if isinstance(value, Mapping) else getattr(value, "kind", None)
    return kind if isinstance(kind, str) else None


GuidanceParams = Annotated[
    Annotated[PromptGuidanceParams, Tag("sds")]
    | Annotated[TargetGuidanceParams, Tag("target")]
    | Annotated[SilhouetteGuidanceParams, Tag("silhouettes")]
    | Annotated[ExemplarGuidanceParams, Tag("exemplar")]
    | Annotated[OpenGuidanceParams, Tag(OPEN)],
    Discriminator(
        _kind_of_guidance,
        custom_error_type="guidance_kind",
        custom_error_message="kind is sds, target, silhouettes or exemplar",
    ),
]


class DeformParams(CommonParams):
    """The parameters of a deformation as a user writes them; the rest comes from the preset."""

    guidance: GuidanceParams = Field(
        default_factory=OpenGuidanceParams,
        description="Guidance of the deformation, by `kind`: `exemplar` (what the prompt's noun stands for, part to "
        "part), `sds` (a diffusion model and the prompt), `target` (a second mesh, sent as the field `target`) or "
        "`silhouettes` (pictures alone). Default: the first that fits the files and the prompt and has every option "
        "that was sent ([Which kind](parameters.md#which-kind)).",
        examples=[{"strength": 0.9}, {"kind": "sds"}],
    )
    control: ControlParams = Field(
        default_factory=ControlParams,
        description="Parts that may move and properties that the result keeps, with any guidance.",
        examples=[{"regions": [{"node": "Hinge"}]}],
    )

    input: InputParams = Field(
        default_factory=InputParams,
        description="How the asset's file is to be read: its upward axis and its unit.",
        examples=[{"up": "z"}],
    )

    @field_validator("guidance", mode="before")
    @classmethod
    def _is_an_object(cls, value: Any) -> Any:
        if isinstance(value, str):
            raise ValueError(f'it is an object now: {{"kind": "{value}"}}')  # noqa: TRY004 - a finding, no crash
        kind = value.get("kind") if isinstance(value, dict) else None
        if isinstance(kind, str) and kind not in list(GuidanceKind):
            raise ValueError(did_you_mean(kind, list(GuidanceKind), "kind of guidance"))
        return value

    @property
    def kind(self) -> GuidanceKind:
        """The kind of guidance; `sds` where none is named, which was the default of earlier versions."""
        return GuidanceKind.SDS if isinstance(self.guidance, OpenGuidanceParams) else GuidanceKind(self.guidance.kind)

    @property
    def model(self) -> str | None:
        """The model that was written."""
        return self.guidance.model if isinstance(self.guidance, ModelParams) else None

    @property
    def prompts(self) -> tuple[WeightedPromptParams, ...]:
        """The further prompts."""
        return self.guidance.prompts if isinstance(self.guidance, WordParams) else ()

    @property
    def silhouettes(self) -> tuple[ViewParams, ...]:
        """The directions of the pictures."""
        return self.guidance.silhouettes if isinstance(self.guidance, PictureParams) else ()

    def with_model(self, model: str) -> Self:
        """Return the parameters with another model; a guidance without one stays as it is."""
        if not isinstance(self.guidance, ModelParams):
            return self
        return self.model_copy(update={"guidance": self.guidance.model_copy(update={"model": model})})

    def flat(self) -> dict[str, Any]:
        """Return the parameters that were written, by their names alone."""
        own = {name: getattr(self, name) for name in self.model_fields_set - {"guidance", "control", "input"}}
        for group in (self.guidance, self.control, self.input):
            own |= {name: getattr(group, name) for name in group.model_fields_set - {"kind"}}
        return own


class ResolvedParams(ControlParams, InputParams, ExemplarParams, TargetParams, PromptParams, CommonParams):
    """Every parameter with its value, without groups: the basis of the run, the report and the parameter hash.

    The members that no group of `DeformParams` has are constants of the method, or of a preset for one kind of guidance
    (`presets.py`); nobody sends them.
    """

    model_config = ConfigDict(json_schema_serialization_defaults_required=True)

    guidance: GuidanceKind = Field(GuidanceKind.SDS, description="Guidance of the deformation.", examples=["sds"])
    model: str = Field(BUILTIN_MODEL, description="The diffusion model of `sds`.", examples=[BUILTIN_MODEL])
    guidance_weight: float = Field(1.0, description="Weight of the guidance loss.")
    guidance_rescale: float = Field(
        0.0, description="How far the contrast of the guided picture is rescaled to that of an unguided one."
    )
    timestep_max: float = Field(0.98, description="Highest timestep drawn at the first step, as a fraction of T.")
    timestep_max_end: float = Field(
        0.98, description="Highest timestep drawn at the last step; in between the bound moves linearly."
    )
    stiffness: float = Field(
        1.0,
        description="Multiple of the weights that hold the shape together at the first step; it falls to 1 by two "
        "thirds of the run.",
    )
    framing: float = Field(
        0.9,
        description="Size of the undeformed asset in the picture: its half extent over the radius of the sphere that "
        "just fits the view.",
    )
    framing_max: float = Field(
        0.9,
        description="Size in the picture up to which the asset may grow before the camera moves back; if equal to "
        "`framing`, the camera follows at once, as in the published code.",
    )
    elevation_min_deg: float = Field(0.0, description="Lowest camera elevation in degrees.")
    elevation_max_deg: float = Field(30.0, description="Highest camera elevation in degrees.")
    fov_min_deg: float = Field(30.0, description="Lowest vertical field of view in degrees.")
    fov_max_deg: float = Field(45.0, description="Highest vertical field of view in degrees.")


GUIDANCES: Mapping[GuidanceKind, type[Parameters]] = {
    GuidanceKind.SDS: PromptGuidanceParams,
    GuidanceKind.TARGET: TargetGuidanceParams,
    GuidanceKind.SILHOUETTES: SilhouetteGuidanceParams,
    GuidanceKind.EXEMPLAR: ExemplarGuidanceParams,
}
"""The parameters of each kind of guidance."""

_PARAMETERS = (CommonParams, PromptParams, TargetParams, ExemplarParams, ControlParams, InputParams)

CONSTANTS = ResolvedParams.model_fields.keys() - {"guidance"}.union(*(each.model_fields for each in _PARAMETERS))
"""The constants of the method and of presets, which no request has."""

FROM_PRESET = frozenset(name for name in ResolvedParams.model_fields if _is_of_preset(ResolvedParams, name))
"""The parameters whose default comes from the preset."""
