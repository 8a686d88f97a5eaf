"""What the diffusion prior of a run computes in, also where another machine resumes it."""

from __future__ import annotations

from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.priors.base import Prior

__all__ = ["precision_of", "precision_warnings"]

_THEN = ", "


def precision_of(prior: Prior | None, state: Checkpoint | None = None) -> str | None:
    """Return what a run computes in, such as `float32`; None without a prior.

    Where the run resumes at a state that was computed in another precision, both are named, in order.
    """
    if prior is None:
        return None
    now, before = str(prior.dtype).removeprefix("torch."), state.precision if state else ""
    if not before:
        return now
    return before if before.split(_THEN)[-1] == now else f"{before}{_THEN}{now}"


def precision_warnings(precision: str | None) -> list[str]:
    """Return a warning of a run that was resumed in another precision."""
    if precision is None or _THEN not in precision:
        return []
    return [
        f"The run was resumed in another precision: the model computed in {precision}, in this order. "
        "On one machine the same job gives a slightly different result."
    ]
