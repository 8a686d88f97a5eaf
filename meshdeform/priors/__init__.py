"""Check and load the text-to-image diffusion models for score distillation by name. Importing this needs no torch.

`check_model` checks cheaply, before a job is accepted, whether a model is available; `load_prior` loads it.
`public_names` names models to clients without revealing where their folders are.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from meshdeform.errors import DependencyError, ModelError
from meshdeform.requests.choices import is_weights_file
from meshdeform.requests.document import BUILTIN_MODEL

if TYPE_CHECKING:
    from meshdeform.priors.base import Prior

__all__ = ["check_model", "configured_name", "hidden_folders", "load_prior", "public_name", "public_names"]


def check_model(model: str, revision: str = "") -> None:
    """Check, without torch and without a network, whether `load_prior` would find the model.

    An environment without torch does not run models (for example, the API's own container). There, nothing is checked
    but files of weights of the builtin prior, and the worker reports a missing model.

    Parameters
    ----------
    model : str
        `builtin`, a file of weights for it (`.safetensors`), the folder of a Stable Diffusion checkpoint, or its hub
        id.
    revision : str
        Branch, tag or commit of a hub model; by default its default branch.

    Raises
    ------
    ModelError
        The model is not on this machine, or is not a Stable Diffusion checkpoint with safetensors weights.
    KindRetiredError
        The words of the file of weights were taught.
    DependencyError
        The model needs packages that are not installed.
    """
    if model == BUILTIN_MODEL:
        return
    if is_weights_file(model):
        from meshdeform.priors.builtin.weights_file import check as check_weights

        check_weights(Path(model).expanduser())
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
        Precision: `auto`, `float32`, `float16` or `bfloat16`. The builtin prior has float32, also for `auto` and
        `float16`, and bfloat16.

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
    if is_weights_file(model):
        from meshdeform.priors.builtin.prior import BuiltinPrior

        return BuiltinPrior(device=device, weights=Path(model).expanduser(), dtype=dtype)
    from meshdeform.priors.stable_diffusion import StableDiffusionPrior

    return StableDiffusionPrior(model, device=device, revision=revision, dtype=dtype)


def public_names(models: Sequence[str]) -> dict[str, str]:
    """Return the id of each model: a folder's own name, with a digest where two would be equal; hub ids stay."""
    names = {model: public_name(model) for model in models}
    count = Counter(names.values())
    return {
        model: name if name == model or count[name] == 1 else f"{name}-{hashlib.sha256(model.encode()).hexdigest()[:8]}"
        for model, name in names.items()
    }


def public_name(model: str) -> str:
    """Return the last part of the path of a folder or of a file of weights; a hub id stays."""
    if is_weights_file(model):
        return Path(model).name
    absolute_or_relative = model.startswith(("/", ".", "~")) or "\\" in model or model.count("/") > 1
    if absolute_or_relative or Path(model).is_dir():
        return Path(model).expanduser().resolve().name or "model"
    return model


def configured_name(name: str, models: Sequence[str]) -> str:
    """Return the model as configured whose id or configured name a client gave, or the name itself."""
    if name in models:
        return name
    return next((model for model, known in public_names(models).items() if known == name), name)


@contextmanager
def hidden_folders(models: Sequence[str]) -> Iterator[None]:
    """Replace the models' folders by their ids in the errors of the `with` block."""
    try:
        yield
    except (ModelError, DependencyError) as error:
        raise type(error)(
            _hidden(error.detail, models), advice=_hidden(error.advice_text, models), **error.extra
        ) from error


def _hidden(text: str, models: Sequence[str]) -> str:
    spellings = dict[str, str]()
    for model, name in public_names(models).items():
        if name != model:
            path = Path(model).expanduser()
            spellings |= dict.fromkeys((model, model.rstrip("/"), str(path), str(path.resolve())), name)
    for spelling in sorted((text for text in spellings if len(text) > 2), key=len, reverse=True):
        text = text.replace(spelling, spellings[spelling])
    return text
