"""Keep pictures of what was taught in the file of weights, for replay when it is taught again."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import torch
from torch import Tensor

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import SEQUENCE_LENGTH
from meshdeform.priors.builtin.network import IMAGE_SIZE
from meshdeform.priors.builtin.taught import words_of
from meshdeform.priors.builtin.training.dataset import PictureSet
from meshdeform.priors.builtin.weights_file import REPLAY, read_tensors

__all__ = ["read_replay", "replay_tensors"]


def read_replay(path: Path) -> dict[str, PictureSet]:
    """Read the pictures of nouns that a file of weights was taught, by noun; nothing for the weights in the package.

    Raises
    ------
    ModelError
        The file is unreadable, or its pictures do not have the shapes of a `PictureSet`.
    """
    state, metadata = read_tensors(path)
    words = words_of(metadata, path)
    found = {}
    for noun in words.nouns:
        tensors = {field.name: state.get(f"{REPLAY}{noun}.{field.name}") for field in fields(PictureSet)}
        images = tensors["images"]
        if images is None:
            continue
        shapes = {
            "images": (len(images), 3, IMAGE_SIZE, IMAGE_SIZE),
            "tokens": (len(images), SEQUENCE_LENGTH),
            "azimuth_deg": (len(images),),
            "single": (len(images),),
        }
        types = {"images": torch.uint8, "tokens": torch.int64, "single": torch.bool, "azimuth_deg": torch.float32}
        whole = {name: t for name, t in tensors.items() if t is not None and tuple(t.shape) == shapes[name]}
        if len(whole) < len(shapes) or not len(images) or any(t.dtype != types[name] for name, t in whole.items()):
            raise _unreadable(path, noun)
        kept = PictureSet(**whole)
        if not 0 <= int(kept.tokens.min()) <= int(kept.tokens.max()) < len(words.tokens):
            raise _unreadable(path, noun)
        found[noun] = kept
    return found


def replay_tensors(noun: str, pictures: PictureSet) -> dict[str, Tensor]:
    """Return the tensors under which a file keeps pictures of a noun."""
    return {f"{REPLAY}{noun}.{field.name}": getattr(pictures, field.name) for field in fields(PictureSet)}


def _unreadable(path: Path, noun: str) -> ModelError:
    return ModelError(
        f"The weights in {path} have unreadable pictures of {noun!r}.",
        advice="Teach the file's words again, from the weights in the package.",
    )
