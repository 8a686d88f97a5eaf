"""Read and keep pictures for replay: of the builtin nouns, which ship with the weights, and of nouns that were taught.

`rehearsal.zip` beside the weights holds for each noun a lossless WebP with its pictures one below the other, and
`labels.json` their prompts and azimuths (`python -m training.prior.rehearsal` writes it). Pictures of a taught noun are
tensors in its file of weights.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypedDict

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import BUILTIN_WORDS, SEQUENCE_LENGTH, Words, parse, tokenise
from meshdeform.priors.builtin.network import IMAGE_SIZE, WEIGHTS, read_tensors
from meshdeform.priors.builtin.taught import REPLAY, words_of
from meshdeform.priors.builtin.teaching.picture_set import PictureSet

REHEARSAL = WEIGHTS.with_name("rehearsal.zip")
LABELS = "labels.json"


class _Label(TypedDict):
    """What one picture shows: `held` pictures measure what a lesson forgets, and are never trained on."""

    prompt: str
    azimuth_deg: float
    single: bool
    held: bool


@dataclass(frozen=True)
class Rehearsal:
    """Pictures of a builtin noun: for training, and those that are held out."""

    training: PictureSet
    held_out: PictureSet


def shipped_pictures(words: Words, path: Path = REHEARSAL) -> dict[str, Rehearsal]:
    """Return the pictures of the builtin nouns that ship with the weights and that `words` knows.

    Raises
    ------
    ModelError
        The file is missing or unreadable.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            labels: dict[str, list[_Label]] = json.loads(archive.read(LABELS))
            known = [noun for noun in labels if noun in words.nouns]
            return {noun: _rehearsal(archive.read(f"{noun}.webp"), labels[noun], words) for noun in known}
    except (OSError, zipfile.BadZipFile, KeyError, ValueError) as error:
        raise ModelError(
            f"The pictures that lessons rehearse, {path.name}, cannot be read: {error}",
            advice="Install meshdeform again: the file is part of the package.",
        ) from error


def _rehearsal(picture: bytes, labels: Sequence[_Label], words: Words) -> Rehearsal:
    """Return the pictures of a noun from its file."""
    column = np.array(Image.open(io.BytesIO(picture)).convert("RGB"))
    images = torch.from_numpy(column.reshape(len(labels), IMAGE_SIZE, IMAGE_SIZE, 3)).permute(0, 3, 1, 2).contiguous()
    pictures = PictureSet(
        images,
        torch.tensor([tokenise(parse(label["prompt"], BUILTIN_WORDS), words) for label in labels]),
        torch.tensor([label["azimuth_deg"] for label in labels], dtype=torch.float32),
        torch.tensor([label["single"] for label in labels]),
    )
    held = torch.tensor([label["held"] for label in labels])
    return Rehearsal(pictures.rows(torch.nonzero(~held)[:, 0]), pictures.rows(torch.nonzero(held)[:, 0]))


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
