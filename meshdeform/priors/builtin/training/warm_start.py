"""Begin with the weights of another edition, whose vocabulary is another.

Tensors of the same name and shape are copied. The word embedding is copied row by row, by word; a word that the other
edition did not have starts at the mean of the words of its kind (nouns, words for how much, words for
which part) with a little noise, so that the network takes it for an average one and can tell two of them apart.
All else keeps the initialisation of the network, which for the conditions of a single view is zero: what the
other edition predicted for an old prompt, this network predicts.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import NOUNS, PARTS, VOCABULARY
from meshdeform.priors.builtin.network import PriorNetwork
from meshdeform.priors.builtin.vocabulary import SECOND_EDITION
from meshdeform.priors.builtin.weights_file import read_tensors, vocabulary_hash

__all__ = ["warm_start"]

_WORDS = "text.word.weight"
_NOISE = 0.3
"""Of a new word, as a share of the spread of its kind."""


def warm_start(network: PriorNetwork, path: Path, generator: torch.Generator) -> tuple[str, ...]:
    """Copy what fits from a file of weights into a network, in place.

    Parameters
    ----------
    network : PriorNetwork
    path : pathlib.Path
        A file that `train.py` wrote, of this or another edition. It names its words in its metadata; a file of
        the first edition, which does not, is known by its hash.
    generator : torch.Generator on the CPU
        For the noise on new words.

    Returns
    -------
    tuple of str
        The names of the tensors that the file did not have in the network's shape.

    Raises
    ------
    ModelError
        The file is missing or unreadable, its words are not known, or it is of a network of other sizes.
    """
    held, metadata = read_tensors(path)
    words = _words_of(path, metadata)
    state = network.state_dict()
    own = {name: tensor for name, tensor in held.items() if name in state and name != _WORDS}
    foreign = [name for name, tensor in own.items() if tensor.shape != state[name].shape]
    if foreign or _WORDS not in held or held[_WORDS].shape != (len(words), state[_WORDS].shape[1]):
        raise ModelError(
            f"The weights in {path} are of a network of other sizes: {', '.join(foreign) or _WORDS}.",
            advice="Train from nothing, without --initial.",
        )
    with torch.no_grad():
        for name, tensor in own.items():
            state[name].copy_(tensor)
        state[_WORDS].copy_(_word_rows(held[_WORDS], words, generator))
    return tuple(name for name in state if name not in held)


def _words_of(path: Path, metadata: dict[str, str]) -> list[str]:
    """The vocabulary of a file, in the order of its token numbers."""
    first = [word for word in VOCABULARY if word not in SECOND_EDITION]
    if "words" in metadata:
        return metadata["words"].split()
    if metadata.get("vocabulary") == vocabulary_hash(first):
        return first
    raise ModelError(f"The weights in {path} do not say their vocabulary.", advice="Train from nothing.")


def _word_rows(rows: Tensor, words: list[str], generator: torch.Generator) -> Tensor:
    """(len(VOCABULARY), width): the rows of known words in this vocabulary's order, new words between them."""
    number = {word: row for row, word in enumerate(words)}
    made = []
    for word in VOCABULARY:
        if word in number:
            made.append(rows[number[word]])
            continue
        kind = _kind(word)
        peers = rows[[row for other, row in number.items() if _kind(other) == kind]]
        noise = torch.randn(rows.shape[1], generator=generator)
        made.append(peers.mean(0) + _NOISE * peers.std(0) * noise)
    return torch.stack(made)


def _kind(word: str) -> str:
    if word in NOUNS:
        return "noun"
    if word in PARTS:
        return "part"
    return "degree" if word in VOCABULARY[1:] and word != "whole" else "other"
