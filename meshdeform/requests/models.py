"""Tell by its name what kind of model a job asks for. Torch-free, and without a look at any file."""

from __future__ import annotations

from meshdeform.requests.parameters import BUILTIN_MODEL

__all__ = ["TAUGHT_SUFFIX", "is_builtin", "is_taught"]

TAUGHT_SUFFIX = ".safetensors"
"""A model whose name ends so is the builtin prior with taught words: a file that `meshdeform teach` wrote."""


def is_taught(model: str) -> bool:
    """Return whether a model is a file of weights that `meshdeform teach` wrote."""
    return model.endswith(TAUGHT_SUFFIX)


def is_builtin(model: str) -> bool:
    """Return whether a model is the builtin prior, with the words of the package or with taught ones."""
    return model == BUILTIN_MODEL or is_taught(model)
