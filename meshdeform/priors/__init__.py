"""Priors: text-to-image diffusion models behind score distillation. Nothing heavy is imported until one is loaded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from meshdeform.config import BUILTIN_MODEL

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["check_model", "load_prior"]


def load_prior(model: str, *, device: str = "cpu", revision: str = "") -> Prior:
    """Load a prior; seconds to minutes, so workers keep it between jobs.

    Parameters
    ----------
    model : str
        `builtin`, a folder with a Stable Diffusion checkpoint in diffusers' layout, or a hub id that is in the
        local cache.
    device : str
    revision : str
        Branch, tag or commit of a hub model.

    Raises
    ------
    ModelError
        It is not there, or not complete.
    DependencyError
        The packages that run it are not installed.
    """
    if model == BUILTIN_MODEL:
        from meshdeform.priors.builtin.prior import BuiltinPrior

        return BuiltinPrior(device=device)
    from meshdeform.priors.stable_diffusion import StableDiffusionPrior

    return StableDiffusionPrior(model, device=device, revision=revision)


def check_model(model: str, revision: str = "") -> None:
    """Say early and cheaply, without torch, that a model cannot be loaded here.

    Raises
    ------
    ModelError
        It is not there, or not complete.
    """
    if model == BUILTIN_MODEL:
        return
    from meshdeform.priors.model_files import check_model_files

    check_model_files(model, revision)
