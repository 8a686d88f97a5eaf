"""Count what drawings by people are taken for at first sight, of those that nothing was learnt from.

    python -m bench.sketch_people quickdraw/

The folder has ndjson files of drawings (Quick, Draw! by Google, CC-BY 4.0), one of each word, the lines by their
`key_id`; every fourth drawing of a word is looked at. With the weights of `training.sketch.train --hold-out`,
`--held-out` counts the words that nothing was learnt from.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from meshdeform.kinds.sketch.guessing import SURE
from meshdeform.kinds.sketch.looking import WEIGHTS, read_projection
from training.sketch.people import noun_of, read_people


def main() -> None:
    """Print the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("people", type=Path)
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--held-out", action="store_true")
    options = parser.parse_args()
    projection = read_projection(options.weights)
    people = read_people(options.people, hold_out=options.held_out)
    places, sure, others = [], [], []
    for number in np.flatnonzero(people.to_measure & (people.strange | ~np.bool_(options.held_out))):
        likely = projection.likelihoods(people.pictures[number], {})
        order = sorted(likely, key=lambda noun: -likely[noun])
        if people.ours[number]:
            places.append(order.index(noun_of(str(people.words[number]))))
            sure.append(likely[order[0]] >= SURE)
        else:
            others.append(likely[order[0]] >= SURE)
    first, is_sure = np.array(places), np.array(sure)
    print(f"{len(first)} drawings: first {np.mean(first == 0):.1%}, among three {np.mean(first < 3):.1%}")
    print(f"sure of {int(is_sure.sum())}, of which {int((first == 0)[is_sure].sum())} are right")
    print(f"sure of {sum(others)} of {len(others)} of other things")


if __name__ == "__main__":
    main()
