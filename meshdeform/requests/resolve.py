"""Resolve the parameters of a deformation from those of the user, the preset and the paper. Torch-free."""

from __future__ import annotations

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import Carrier, GuidanceKind
from meshdeform.requests.parameters import BUILTIN_MODEL, DeformParams, ResolvedParams, contradiction
from meshdeform.requests.presets import OVERRIDES, Family

__all__ = ["resolve"]


def resolve(params: DeformParams, *, default_model: str = BUILTIN_MODEL) -> ResolvedParams:
    """Return every parameter: the user's value, else the preset's for this kind of guidance, else the paper's.

    Parameters
    ----------
    params : DeformParams
        What the user wrote.
    default_model : str
        The model if the user named none (the setting MESHDEFORM_MODEL).

    Raises
    ------
    ParameterError
        A bound of the user contradicts one of the preset, or there are rigid parts without a lattice.
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
            f"{low} is {values[low]} and {high} is {values[high]}: your bound contradicts the preset's.",
            advice=f"Set both {low} and {high}.",
        )
    if values["rigid"] and values["carrier"] is Carrier.SURFACE:
        whose = "set" if "carrier" in written else "the preset's"
        detail = f"Rigid parts need the lattice, and carrier is `surface` ({whose})."
        place = {"loc": ["params", "rigid"], "msg": detail, "type": "value_error"}
        raise ParameterError(detail, advice="Set params.carrier to auto or lattice.", errors=[place])
    return ResolvedParams.model_validate(values)
