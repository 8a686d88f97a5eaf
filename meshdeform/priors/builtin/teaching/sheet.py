"""Draw what a network has learned of a noun: a contact sheet by ancestral sampling, from four azimuths."""

from __future__ import annotations

import torch
from PIL import Image
from torch import Tensor

from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.training.dataset import PictureSet
from meshdeform.priors.builtin.training.sample import contact_sheet, sample
from meshdeform.priors.builtin.words import Attribute, ParsedPrompt, Words

__all__ = ["learned_sheet"]

_AZIMUTHS = (0.0, 90.0, 180.0, 270.0)
_STEPS = 24
_SHOWN = ("tall",)


def learned_sheet(network: PriorNetwork, words: Words, noun: str, seen: PictureSet, *, seed: int = 0) -> Image.Image:
    """Draw rows of four pictures: from the training, grids, single views, and two attributes.

    Parameters
    ----------
    network : PriorNetwork
        On the CPU.
    words : Words
    noun : str
    seen : PictureSet
        Pictures of the training, of which the first single views are shown.
    seed : int
    """
    prompts = [ParsedPrompt(noun), *(ParsedPrompt(noun, (Attribute("whole", degree),)) for degree in _SHOWN)]
    plain, *others = map(str, prompts)
    rows = [_training(seen)]
    labels = ["from the training"]
    for text, single in ((plain, False), (plain, True), *((other, True) for other in others)):
        azimuths = torch.tensor(_AZIMUTHS)
        rows.append(sample(network, [text] * 4, azimuths, steps=_STEPS, seed=seed, single=single, words=words, eta=1.0))
        labels.append(f"{text}, azimuths 0, 90, 180, 270" + ("" if single else ", four views each"))
    return contact_sheet(rows, labels)


def _training(seen: PictureSet) -> Tensor:
    shown = seen.images[seen.single][:4]
    blank = torch.zeros(4 - len(shown), *shown.shape[1:], dtype=shown.dtype)
    return torch.cat([shown, blank]).float() / 255.0
