"""The check at the door of `text_deform`: what is wrong with a request, before anything is stored. Torch-free."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from meshdeform.errors import ModelError, ParameterError, PromptError, VocabularyError
from meshdeform.priors import check_model
from meshdeform.requests.document import BUILTIN_MODEL, GuidanceKind, JobRequest, ResolvedParams, resolve

__all__ = ["check"]


def check(
    request: JobRequest,
    *,
    default_model: str,
    allowed_models: Sequence[str] = (),
    revision: str = "",
    has_target: bool = False,
) -> ResolvedParams:
    """Refuse a request that could not run; return its parameters as they would run.

    Parameters
    ----------
    request : JobRequest
    default_model : str
        The model where the request names none; always allowed, as `builtin` is.
    allowed_models : sequence of str
        What else a request may name.
    revision : str
        Revision of the default model.
    has_target : bool
        Whether the second mesh is there that `target` guidance needs.

    Raises
    ------
    ParameterError
        `target` guidance without a target, a target without `target` guidance, or parameters that contradict the preset
        or each other.
    PromptError, VocabularyError
        The prompt is empty, or it or the negative prompt says what the builtin prior does not know.
    ModelError
        The model is not allowed, or not there.
    """
    params = request.params
    resolved = resolve(params, default_model=default_model)
    if params.guidance is GuidanceKind.TARGET:
        if not has_target:
            raise _refusal("guidance", "`target` guidance needs a second mesh.", "Send it as the part `target`.")
        return resolved
    if has_target:
        raise _refusal(
            "guidance",
            "A target was sent, but the guidance is `sds`, which does not look at it.",
            "Set params.guidance to `target`, or leave the part `target` out.",
        )
    if not request.prompt:
        raise PromptError("The prompt is empty.")
    model = params.model or default_model
    if model == BUILTIN_MODEL:
        from meshdeform.priors.builtin.grammar import parse, parse_negative

        parse(request.prompt)
        if params.negative_prompt.strip():
            try:
                parse_negative(params.negative_prompt, request.prompt)
            except (PromptError, VocabularyError) as error:
                # The same error, that also says which of the two texts it is about.
                error.extra |= _at("negative_prompt", error.detail)
                raise
        return resolved
    if model != default_model and model not in allowed_models:
        known = list(dict.fromkeys([BUILTIN_MODEL, default_model, *allowed_models]))
        raise ModelError(
            f"The model {model!r} is not one that this server runs.",
            advice=f"Use one of: {', '.join(known)}. Who runs the server can add it to MESHDEFORM_ALLOWED_MODELS.",
            models=known,
        )
    check_model(model, revision if model == default_model else "")
    return resolved


def _refusal(name: str, detail: str, advice: str) -> ParameterError:
    return ParameterError(detail, advice=advice, **_at(name, detail))


def _at(name: str, detail: str) -> dict[str, Any]:
    """The member of a problem document that says which parameter it is about."""
    return {"errors": [{"loc": ["params", name], "msg": detail, "type": "value_error"}]}
