"""Check and load the text-to-image diffusion models for score distillation by name. Importing this needs no torch.

`check_model` checks cheaply, before a job is accepted, whether a model is available; `load_prior` loads it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from meshdeform.requests.choices import is_taught
from meshdeform.requests.document import BUILTIN_MODEL

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["check_model", "load_prior"]


def check_model(model: str, revision: str = "") -> None:
    """Check, without torch and without a network, whether `load_prior` would find the model.

    An environment without torch does not run models (for example, the API's own container). There, nothing is checked
    but taught weights, whose words the prompts need, and the worker reports a missing model.

    Parameters
    ----------
    model : str
        `builtin`, a file that `meshdeform teach` wrote, the folder of a Stable Diffusion checkpoint, or its hub id.
    revision : str
        Branch, tag or commit of a hub model; by default its default branch.

    Raises
    ------
    ModelError
        The model is not on this machine, or is not a Stable Diffusion checkpoint with safetensors weights.
    DependencyError
        The model needs packages that are not installed.
    """
    if model == BUILTIN_MODEL:
        return
    if is_taught(model):
        from meshdeform.priors.builtin.taught import check as check_taught

        check_taught(Path(model).expanduser())
        return
    from meshdeform.priors.model_files import check

    check(model, revision)


def load_prior(model: str, *, device: str, revision: str = "", dtype: str = "auto") -> Prior:
    """Load a model from this machine; nothing is downloaded.

    Parameters
    ----------
    model, revision : str
        As in `check_model`.
    device : str
        `cpu`, `cuda` or `cuda:N`.
    dtype : str
        Precision: `auto`, `float32`, `float16` or `bfloat16`. The builtin prior has no float16, and uses float32
        instead; its `auto` is bfloat16 on a CPU with matrix instructions for it.

    Raises
    ------
    ModelError
        The model cannot be found or read.
    DependencyError
        The extra that the model needs is not installed.
    """
    if model == BUILTIN_MODEL:
        from meshdeform.priors.builtin.prior import BuiltinPrior

        return BuiltinPrior(device=device, dtype=dtype)
    if is_taught(model):
        from meshdeform.priors.builtin.prior import BuiltinPrior

        return BuiltinPrior(device=device, weights=Path(model).expanduser(), dtype=dtype)
    from meshdeform.priors.stable_diffusion import StableDiffusionPrior

    return StableDiffusionPrior(model, device=device, revision=revision, dtype=dtype)
