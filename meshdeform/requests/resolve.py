"""The parameters that a deformation runs on: the user's, else the preset's for this kind of guidance, else the paper's.

Torch-free. `parameters` says what each of them means, `presets` where the values come from.
"""

from __future__ import annotations

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import GuidanceKind
from meshdeform.requests.parameters import BUILTIN_MODEL, DeformParams, ResolvedParams, contradiction
from meshdeform.requests.presets import OVERRIDES, Family

__all__ = ["resolve"]


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
        A bound that the user wrote and one of the preset's do not go together.
    """
    model = params.model or default_model
    family: Family = (
        "target" if params.guidance is GuidanceKind.TARGET else "builtin" if model == BUILTIN_MODEL else "sd"
    )
    paper = {name: field.default for name, field in DeformParams.model_fields.items()}
    written = {name: getattr(params, name) for name in params.model_fields_set}
    values = {**paper, **OVERRIDES[family, params.preset], **written, "model": model}
    if found := contradiction(values):
        low, high = found
        raise ParameterError(
            f"{low} is {values[low]} and {high} is {values[high]}: the preset's bound and yours do not go together.",
            advice=f"Set both {low} and {high}.",
        )
    return ResolvedParams.model_validate(values)
