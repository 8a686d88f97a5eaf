"""Name models to clients without revealing where their folders are. Torch-free."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from meshdeform.errors import DependencyError, ModelError
from meshdeform.requests.choices import is_taught

__all__ = ["configured_name", "hidden_folders", "public_name", "public_names"]


def public_names(models: Sequence[str]) -> dict[str, str]:
    """Return the id of each model: a folder's own name, with a digest where two would be equal; hub ids stay."""
    names = {model: public_name(model) for model in models}
    count = Counter(names.values())
    return {
        model: name if name == model or count[name] == 1 else f"{name}-{hashlib.sha256(model.encode()).hexdigest()[:8]}"
        for model, name in names.items()
    }


def public_name(model: str) -> str:
    """Return the last part of the path of a folder or of taught weights; a hub id stays."""
    if is_taught(model):
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
