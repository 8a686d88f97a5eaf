"""Measure the judge on what it was not trained on: ``python -m training.judge.measure --assets FOLDER``.

Of held-out members of each source, of the families, which it never sees, and of real assets (`training.judge.assets`),
it prints how often the noun is first from one view, and first and among three from eight views; calibration; how often
it is right from a probability on; the nouns most often confused; and the likeliest nouns of shapes that are none.
`--only OLD` compares weights: what OLD does not know is left out of the shapes and of the answers.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Collection
from pathlib import Path

import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.judge import WEIGHTS, Judge
from meshdeform.vocabulary.nouns import NOUNS
from training.collections import sources as collections
from training.collections.members import RealShapes
from training.judge.assets import listed, views_of_assets
from training.judge.members import FAMILY, HELD_OUT, OTHER, REAL, ViewSet
from training.judge.network import JudgeNetwork, read_judge
from training.shapes import box, cylinder, torus

SHAPES: dict[str, TriangleMesh] = {
    "sphere": icosphere(3),
    "cube": box(8),
    "cylinder": cylinder(0.5, 1.5, n=48),
    "torus": torus(),
}
"""Shapes that are no noun of the vocabulary."""
_CONFUSED = 12
_FROM = (0.3, 0.5, 0.8, 0.9, 0.97)


def held_out(source: str, members: int, real: RealShapes | None, *, rough: bool) -> ViewSet:
    """Draw held-out members of every noun of a source."""
    nouns = [noun for noun in NOUNS if source != REAL or (real is not None and real.count(noun))]
    return ViewSet.joined(
        [ViewSet.drawn(HELD_OUT, f"{source} {noun}", members, rough=rough, real=real) for noun in nouns]
    )


def calibration_error(probabilities: Tensor, noun: Tensor) -> float:
    """Return the expected calibration error in ten bins of confidence (Guo et al. 2017, eq. 3).

    `probabilities` (M, N), `noun` (M,).
    """
    confidence, guess = probabilities.max(1)
    surplus = (guess == noun).float() - confidence
    return float(torch.zeros(11).index_add(0, (confidence * 10).long(), surplus).abs().sum() / len(noun))


@torch.no_grad()
def line(name: str, network: JudgeNetwork, data: ViewSet, only: Collection[str]) -> str:
    """Return a row of the table, how often it is right from a probability on, and the pairs most often confused.

    `only`: nouns that are asked for and answered.
    """
    known = [noun for noun in network.config.nouns if noun in only]
    place = torch.tensor([known.index(noun) if noun in known else -1 for noun in NOUNS])
    data = ViewSet(data.images, place[data.noun]).rows((place[data.noun] >= 0).nonzero()[:, 0])
    columns = torch.tensor([network.config.nouns.index(noun) for noun in known])
    logits = network(data.images.flatten(0, 1)[:, None].float() / 255.0)[:, columns]
    one_view = float((logits.argmax(1) == data.noun.repeat_interleave(data.images.shape[1])).float().mean())
    probabilities = torch.softmax(logits.view(*data.images.shape[:2], -1).mean(1) * network.sharpness, 1)
    found = probabilities.topk(3).indices == data.noun[:, None]
    first, three = float(found[:, 0].float().mean()), float(found.any(1).float().mean())
    sure, guess = probabilities.max(1)
    wrong = Counter((known[data.noun[row]], known[guess[row]]) for row in (~found[:, 0]).nonzero()[:, 0].tolist())
    shares = (one_view, first, three, float(sure.mean()), calibration_error(probabilities, data.noun))
    row = " | ".join([name, str(len(data)), *(f"{share:.3f}" for share in shares)])
    right = [f"{int(found[sure >= least, 0].sum())} of {int((sure >= least).sum())} from {least}" for least in _FROM]
    told = ", ".join(f"{was} as {answer} {count}" for (was, answer), count in wrong.most_common(_CONFUSED))
    return f"| {row} |\n  right: {', '.join(right)}\n  confused: {told}"


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(
        prog="python -m training.judge.measure", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--members", type=int, default=3, help="held-out members of each noun and source")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--collections", type=Path, help="what training.collections.scan wrote: held-out assets of it")
    parser.add_argument("--assets", type=Path, help="has the files that bench lists (training.judge.assets)")
    parser.add_argument("--only", type=Path, help="weights; ask for the nouns that these know")
    parser.add_argument("--threads", type=int, help="CPU threads")
    arguments = parser.parse_args()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    network, metadata = read_judge(arguments.weights)
    print(
        f"{metadata['steps']} steps, {arguments.weights.stat().st_size} bytes, sharpness {float(network.sharpness):.2f}"
    )
    print("| | shapes | one view | eight views | among three | confidence | calibration error |")
    only = read_judge(arguments.only)[0].config.nouns if arguments.only else tuple(NOUNS)
    real = RealShapes(arguments.collections, collections.HELD_OUT) if arguments.collections else None
    for source in (OTHER, *((REAL,) if real else ()), FAMILY):
        for name, rough in (("as built", False), ("roughened", True)):
            shapes = held_out(source, arguments.members, real, rough=rough)
            print(line(f"{source}, {name}", network, shapes, only), flush=True)
    for name, assets in listed().items() if arguments.assets else ():
        print(line(name, network, views_of_assets(arguments.assets, assets), only), flush=True)
    judge = Judge(arguments.weights)
    for name, mesh in SHAPES.items():
        best = sorted(judge.noun_probabilities(mesh).items(), key=lambda item: -item[1])[:3]
        print(f"{name}: " + ", ".join(f"{noun} {share:.2f}" for noun, share in best))


if __name__ == "__main__":
    main()
