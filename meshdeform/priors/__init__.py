"""Text-to-image diffusion models behind score distillation, by name. Importing this needs no torch.

`check_model` says cheaply, before a job is taken, whether a model can be had; `load_prior` loads it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from meshdeform.requests.document import BUILTIN_MODEL

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["check_model", "load_prior"]


def check_model(model: str, revision: str = "") -> None:
    """Find out without torch and without a network whether `load_prior` would find the model.

    An environment without torch is not one that runs models (the API's own container, say), so there nothing is
    looked for and the worker tells.

    Parameters
    ----------
    model : str
        `builtin`, the folder of a Stable Diffusion checkpoint, or its hub id.
    revision : str
        Branch, tag or commit of a hub model; its default branch unless given.

    Raises
    ------
    ModelError
        It is not on this machine, or is not a Stable Diffusion checkpoint with safetensors weights.
    DependencyError
        It needs packages that are not installed beside torch.
    """
    if model == BUILTIN_MODEL:
        return
    from meshdeform.priors.model_files import check

    check(model, revision)


def load_prior(model: str, *, device: str, revision: str = "", dtype: str = "auto") -> Prior:
    """Load a model; what is not on this machine is not fetched.

    Parameters
    ----------
    model, revision : str
        As in `check_model`.
    device : str
        `cpu`, `cuda` or `cuda:N`.
    dtype : str
        Precision of a Stable Diffusion model: `auto`, `float32`, `float16` or `bfloat16`. The builtin prior has
        float32 everywhere.

    Raises
    ------
    ModelError
        It cannot be found or read.
    DependencyError
        The extra that it needs is not installed.
    """
    if model == BUILTIN_MODEL:
        from meshdeform.priors.builtin.prior import BuiltinPrior

        return BuiltinPrior(device=device)
    from meshdeform.priors.stable_diffusion import StableDiffusionPrior

    return StableDiffusionPrior(model, device=device, revision=revision, dtype=dtype)
