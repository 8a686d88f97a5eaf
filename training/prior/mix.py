"""Mix the weights of two editions: `python -m training.prior.mix OLD NEW --share 0.3`.

The new edition is trained from the old one, and what lies between them on a straight line keeps what the old one drew
better, at a small cost for the new words. Source: Wortsman et al. 2022, Robust fine-tuning of zero-shot models.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from meshdeform.priors.builtin.network import WEIGHTS, PriorNetwork, read_tensors, write_weights
from meshdeform.priors.builtin.vocabulary import VOCABULARY
from meshdeform.support.files import file_sha256
from training.prior.warm_start import warm_start

_WORDS = "text.word.weight"


def mix(old: Path, new: Path, share: float, output: Path) -> None:
    """Write `share` of the old weights and the rest of the new ones; words that only the new ones have are theirs."""
    states = []
    for path in (old, new):
        network = PriorNetwork()
        warm_start(network, path, torch.Generator().manual_seed(0))
        states.append(network.state_dict())
    known = read_tensors(old)[1]["words"].split()
    added = [row for row, word in enumerate(VOCABULARY) if word not in known]
    states[0][_WORDS][added] = states[1][_WORDS][added]
    mixed = {name: torch.lerp(tensor, states[0][name], share) for name, tensor in states[1].items()}
    metadata = {"old": file_sha256(old), "new": file_sha256(new), "share_of_old": str(share)}
    write_weights(output, mixed, network.config, metadata)


def main() -> None:
    """Write the mixed weights."""
    parser = argparse.ArgumentParser(prog="python -m training.prior.mix", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--share", type=float, default=0.3, help="of the old weights")
    parser.add_argument("-o", "--output", type=Path, default=WEIGHTS, help="default: in the package")
    arguments = parser.parse_args()
    mix(arguments.old, arguments.new, arguments.share, arguments.output)


if __name__ == "__main__":
    main()
