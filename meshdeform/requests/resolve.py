"""The parameters that a deformation runs on: the user's, else the preset's for this kind of guidance, else the paper's.

Torch-free. `parameters` says what each of them means, `presets` where the values come from.
"""

from __future__ import annotations

from meshdeform.errors import ParameterError
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
from meshdeform.requests.parameters import BUILTIN_MODEL, ORDERED, DeformParams, StrictModel
from meshdeform.requests.presets import OVERRIDES, PAPER, Family

__all__ = ["ResolvedParams", "resolve"]


class ResolvedParams(StrictModel):
    """Every parameter with its value: what the report records and the parameter hash covers."""

    preset: Preset
    guidance: GuidanceKind
    model: str
    steps: int
    parametrization: Parametrization
    views: ViewMode
    seed: int
    learning_rate: float
    translation_rate: float
    guidance_scale: float
    guidance_rescale: float
    distillation: Distillation
    ism_interval: float
    ism_stride: float
    noise_draws: int
    optimizer: Optimizer
    rigidity: Rigidity
    safeguard: Safeguard
    negative_prompt: str
    negative: NegativePrompt
    negative_weight: float
    view_prompts: bool
    timestep_min: float
    timestep_min_end: float
    timestep_max: float
    timestep_max_end: float
    guidance_weight: float
    jacobian_reg_weight: float
    laplacian_weight: float
    normal_weight: float
    attachment_weight: float
    dirichlet_weight: float
    learning_rate_end: float
    regularizer_scale_end: float
    annealing: Annealing
    resolution_start: float
    smoothing_start: float
    coarse_until: float
    stop_when_settled: float
    candidates: int
    candidate_steps: int
    elevation_min_deg: float
    elevation_max_deg: float
    fov_min_deg: float
    fov_max_deg: float
    checkpoint_every_steps: int

    @property
    def total_steps(self) -> int:
        """Steps in all, those of candidates that are given up included; fewer where a run settles before its end."""
        return self.steps + sum((alive - 1) * self.candidate_steps for alive in self.rungs)

    @property
    def rungs(self) -> tuple[int, ...]:
        """How many candidates there are in each round until one is left: 5, 3, 2 of five."""
        alive, found = self.candidates, []
        while alive > 1:
            found.append(alive)
            alive = (alive + 1) // 2
        return tuple(found)


def resolve(params: DeformParams, *, default_model: str = BUILTIN_MODEL) -> ResolvedParams:
    """Fill what the user left out: the user's value, else the preset's for this kind of guidance, else the paper's.

    Parameters
    ----------
    params : DeformParams
        What the user wrote.
    default_model : str
        The model where the user named none (the setting MESHDEFORM_MODEL).

    Raises
    ------
    ParameterError
        A bound that the user wrote and one of the preset's do not go together, or other parameters that do not.
    """
    model = params.model or default_model
    family: Family = (
        "target" if params.guidance is GuidanceKind.TARGET else "builtin" if model == BUILTIN_MODEL else "sd"
    )
    values = {**PAPER, **OVERRIDES[family, params.preset]}
    written = {k: v for k, v in params.model_dump().items() if v is not None}
    if "timestep_min" in written:
        written.setdefault("timestep_min_end", written["timestep_min"])
    if "learning_rate" in written:
        written.setdefault("learning_rate_end", written["learning_rate"])
    values.setdefault("learning_rate_end", values["learning_rate"])
    resolved = ResolvedParams(**{**values, **written, "model": model})
    for low, high in ORDERED:
        if getattr(resolved, low) > getattr(resolved, high):
            raise ParameterError(
                f"{low} is {getattr(resolved, low)} and {high} is {getattr(resolved, high)}: "
                "the preset's bound and yours do not go together.",
                advice=f"Set both {low} and {high}.",
            )
    if resolved.guidance is GuidanceKind.SDS:
        _check_texts(resolved, family)
    if resolved.smoothing_start and resolved.parametrization is not Parametrization.JACOBIANS:
        raise ParameterError(
            "smoothing_start smooths the gradient of Jacobians, and the run moves vertices.",
            advice="Leave smoothing_start out, or set parametrization to jacobians.",
        )
    if len(resolved.rungs) * resolved.candidate_steps > resolved.steps:
        raise ParameterError(
            f"{resolved.candidates} candidates need {len(resolved.rungs)} rounds of {resolved.candidate_steps} steps, "
            f"and the run has {resolved.steps}.",
            advice="Lower candidates or candidate_steps, or raise steps.",
        )
    return resolved


def _check_texts(params: ResolvedParams, family: Family) -> None:
    """Refuse what would have no effect, or two uses of one text."""
    if params.view_prompts and family == "builtin":
        raise ParameterError(
            "view_prompts are for Stable Diffusion models: the builtin prior is told each camera's azimuth itself.",
            advice="Leave view_prompts out.",
        )
    if params.view_prompts and params.views is ViewMode.ORTHOGONAL_GRID:
        raise ParameterError(
            "view_prompts need pictures of one view each, and `views: orthogonal_grid` shows four in one.",
            advice="Set views to orthogonal_batch, random_batch or random_single; or leave view_prompts out and say it "
            'of the whole picture in the prompt, such as "four views of a giraffe".',
        )
    if params.negative is not NegativePrompt.PERPENDICULAR:
        return
    if params.distillation is Distillation.NFSD:
        raise ParameterError(
            "`distillation: nfsd` has a use of its own for the negative prompt.",
            advice="Leave `negative` out, or choose another distillation.",
        )
    if not params.negative_prompt.strip() and not params.view_prompts:
        raise ParameterError(
            "`negative: perpendicular` has nothing to keep away from.",
            advice="Give a negative_prompt, or leave `negative` out.",
        )
