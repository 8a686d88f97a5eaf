"""Initialise a network with the weights of another edition that has another vocabulary.

Tensors of the same name and shape are copied. The word embedding is copied row by row, by word. A new word starts at
the mean of the words of its kind (nouns, degrees, parts) with a little noise, so that it acts as an average word but
differs from other new words. Everything else keeps the initialisation of the network, which is zero for the conditions
of a single view: for an old prompt, this network predicts the same as the other edition.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import VOCABULARY
from meshdeform.priors.builtin.network import PriorNetwork, read_tensors
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.vocabulary.nouns import PARTS

_WORDS = "text.word.weight"
_NOISE = 0.3
"""Standard deviation of the noise on a new word, relative to that of its kind."""


def warm_start(network: PriorNetwork, path: Path, generator: torch.Generator) -> tuple[str, ...]:
    """Copy the tensors that fit from a file of weights into a network, in place.

    Parameters
    ----------
    network : PriorNetwork
    path : pathlib.Path
        A file written by `train.py`, of this or another edition, whose metadata lists its words.
    generator : torch.Generator on the CPU
        For the noise on new words.

    Returns
    -------
    tuple of str
        Names of the network's tensors that are not in the file.

    Raises
    ------
    ModelError
        The file is missing or unreadable, or of an unknown vocabulary or a network of another size.
    """
    loaded, metadata = read_tensors(path)
    words = _words_of(path, metadata)
    state = network.state_dict()
    matching = {name: tensor for name, tensor in loaded.items() if name in state and name != _WORDS}
    mismatched = [name for name, tensor in matching.items() if tensor.shape != state[name].shape]
    if mismatched or _WORDS not in loaded or loaded[_WORDS].shape != (len(words), state[_WORDS].shape[1]):
        raise ModelError(
            f"The weights in {path} are of a network of another size: {', '.join(mismatched) or _WORDS}.",
            advice="Train from scratch, without --initial.",
        )
    with torch.no_grad():
        for name, tensor in matching.items():
            state[name].copy_(tensor)
        state[_WORDS].copy_(_word_rows(loaded[_WORDS], words, generator))
    return tuple(name for name in state if name not in loaded)


def _words_of(path: Path, metadata: dict[str, str]) -> list[str]:
    """Return the vocabulary of a file, in the order of its token numbers."""
    if "words" in metadata:
        return metadata["words"].split()
    raise ModelError(f"The weights in {path} do not name their vocabulary.", advice="Train from scratch.")


def _word_rows(rows: Tensor, words: list[str], generator: torch.Generator) -> Tensor:
    """Return the rows (len(VOCABULARY), width) of known and new words in the order of this vocabulary."""
    number = {word: row for row, word in enumerate(words)}
    made = []
    for word in VOCABULARY:
        if word in number:
            made.append(rows[number[word]])
            continue
        kind = _kind(word)
        peers = rows[[row for other, row in number.items() if _kind(other) == kind]]
        noise = torch.randn(peers.shape[1], generator=generator)
        made.append(peers.mean(0) + _NOISE * peers.std(0) * noise)
    return torch.stack(made)


def _kind(word: str) -> str:
    if word in NOUNS:
        return "noun"
    if word in PARTS:
        return "part"
    return "degree" if word in VOCABULARY[1:] and word != "whole" else "other"
