"""Resolve the parameters of a deformation from those of the user, the preset and the paper. Torch-free."""

from __future__ import annotations

from meshdeform.errors import ParameterError
from meshdeform.requests.bounds import contradiction
from meshdeform.requests.choices import AppearanceMode, Carrier, Encoder, GuidanceKind
from meshdeform.requests.control import LengthLimits
from meshdeform.requests.models import is_builtin
from meshdeform.requests.parameters import BUILTIN_MODEL, DeformParams, ResolvedParams
from meshdeform.requests.presets import OVERRIDES, Family
from meshdeform.requests.prompts import contradicted
from meshdeform.requests.stages import goal_guidance

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
        A bound of the user contradicts one of the preset, rigid parts one that they cannot have, the guidance cannot
        use the appearance, the model has no encoder to choose, or stages contradict a parameter for one goal.
    """
    params = _with_goal(params)
    model = params.model or default_model
    family: Family = "builtin" if is_builtin(model) else "sd"
    if params.guidance is not GuidanceKind.SDS:
        family = "target" if params.guidance is GuidanceKind.TARGET else "silhouettes"
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
        raise _refused("rigid", detail, "Set params.carrier to auto or lattice.")
    if family != "sd" and values["appearance"] != AppearanceMode.NORMALS:
        whose = "The built-in model was trained on" if family == "builtin" else "A mesh or a picture is compared by"
        detail = f"{whose} pictures of normals, and appearance is `{values['appearance']}`."
        raise _refused("appearance", detail, "Leave params.appearance out, or use a Stable Diffusion model.")
    if values["encoder"] is not Encoder.VAE and is_builtin(model):
        detail = f"The built-in model works on pixels and has no encoder, and encoder is `{values['encoder']}`."
        raise _refused("encoder", detail, "Leave params.encoder out, or use a Stable Diffusion model.")
    if values["rigid"] and values["length"] != LengthLimits():
        detail = "Rigid parts cannot be stretched or compressed to meet a limit of `length`."
        raise _refused("length", detail, "Leave out params.length or params.rigid.")
    return ResolvedParams.model_validate(values)


def _with_goal(params: DeformParams) -> DeformParams:
    """Return the parameters with the guidance that their stages or their generated target imply.

    Raises
    ------
    ParameterError
        They contradict each other.
    """
    guidance = goal_guidance(params)
    if params.target is not None and params.silhouettes:
        raise _refused("silhouettes", "Pictures cannot guide beside a target mesh.", "Leave out one of the two.")
    for other in ("target", "sketch", "landmarks", "silhouettes"):
        if params.stages and getattr(params, other):
            raise _refused(other, f"`{other}` belongs to a single goal, and there are stages.", f"Leave out {other}.")
    if params.target is not None and params.sketch is not None:
        raise _refused("sketch", "`target` and `sketch` both say what the target is.", "Leave out one of the two.")
    if params.sketch is not None and params.silhouettes:
        raise _refused("silhouettes", "Pictures cannot guide beside a target mesh.", "Leave out one of the two.")
    if found := contradicted(params, guidance):
        other, why = found
        raise _refused(
            "prompts", f"`prompts` cannot be combined with `{other}`: {why}.", f"Leave out prompts or {other}."
        )
    if "guidance" in params.model_fields_set and params.guidance is not guidance:
        detail = f"guidance is `{params.guidance}`, and `{_said_by(params)}` needs `{guidance}`."
        raise _refused("guidance", detail, "Leave params.guidance out.")
    return params if params.guidance is guidance else params.model_copy(update={"guidance": guidance})


def _said_by(params: DeformParams) -> str:
    return "stages" if params.stages else "sketch" if params.sketch is not None else "target"


def _refused(name: str, detail: str, advice: str) -> ParameterError:
    place = {"loc": ["params", name], "msg": detail, "type": "value_error"}
    return ParameterError(detail, advice=advice, errors=[place])
