"""Measure the judge on members that neither it nor the prior was trained on.

Run it as ``python -m training.judge.measure``.

Prints the top-1 accuracy of the noun from one view and from eight; retrieval of the whole prompt among twelve, among
the plain nouns and the variants of the noun, and among the variants alone; calibration; the pairs most often confused,
the nouns that are found least often, and the judgements of shapes that are no noun. Members of the families and
members by the judge's own code are measured apart; of the latter, variants are not compared: their truth is not known.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.judge.scoring import WEIGHTS, Judge, JudgeNetwork, encoded, read_judge
from meshdeform.nouns.families import FAMILIES
from meshdeform.priors.builtin.grammar import ATTRIBUTES, ParsedPrompt
from meshdeform.priors.builtin.vocabulary import NOUNS
from training.collections import sources as collections
from training.collections.members import RealShapes
from training.judge.members import HELD_OUT, ViewSet
from training.shapes import box, cylinder, torus

SHAPES: dict[str, TriangleMesh] = {
    "sphere": icosphere(3),
    "cube": box(8),
    "cylinder": cylinder(0.5, 1.5, n=48),
    "torus": torus(),
}
"""Shapes that are no noun of the vocabulary."""

_SOURCES = {"of the families": "", "by the judge's own code": "other ", "of collections": "real "}
"""Where members come from, with what names of kinds begin with."""


def prompts_of(data: ViewSet) -> list[ParsedPrompt]:
    """Return the true prompt of each mesh, for a set in which every shape shows a noun."""
    names = list(NOUNS)
    return [
        ParsedPrompt(names[noun], tuple(ATTRIBUTES[number] for number in row.nonzero()[:, 0].tolist()))
        for noun, row in zip(data.noun.tolist(), data.attributes, strict=True)
    ]


def variants(noun: str) -> list[ParsedPrompt]:
    """Return the noun alone, and with each single attribute."""
    attributes = [attribute for attribute in ATTRIBUTES if attribute.part in ("whole", *NOUNS[noun])]
    return [ParsedPrompt(noun), *(ParsedPrompt(noun, (attribute,)) for attribute in attributes)]


class _Measured:
    """Outputs of the network for every view of a set, computed once."""

    @torch.no_grad()
    def __init__(self, network: JudgeNetwork, data: ViewSet) -> None:
        self.network, self.data, self.prompts = network, data, prompts_of(data)
        self.views = data.images.shape[1]
        self.noun_logits, self.features = network.encode_views(data.images.flatten(0, 1)[:, None].float() / 255.0)

    def nouns_of_views(self) -> float:
        """Return the share of single views whose likeliest noun is correct."""
        return _share(self.noun_logits.argmax(1) == self.data.noun.repeat_interleave(self.views))

    def noun_probabilities(self) -> Tensor:
        """Return the probabilities (M, N) of nouns from all views of each mesh."""
        mean = self.noun_logits.view(len(self.data), self.views, -1).mean(1)
        return torch.softmax(mean * self.network.noun_sharpness, 1)

    @torch.no_grad()
    def retrieves(self, row: int, candidates: list[ParsedPrompt]) -> tuple[bool, float]:
        """Return whether the mesh's own prompt (added if missing) scores highest, and the highest probability."""
        candidates = list(dict.fromkeys([*candidates, self.prompts[row]]))
        at = slice(row * self.views, (row + 1) * self.views)
        scores = self.network.scores(self.noun_logits[at], self.features[at], encoded(candidates)).mean(0)
        likely = torch.softmax(scores * self.network.prompt_sharpness, 0)
        return candidates[int(scores.argmax())] == self.prompts[row], float(likely.max())

    def retrieval(self) -> dict[str, list[float]]:
        """Return, by set of candidates, the top-1 for no, one and two attributes and overall, and the confidence."""
        rng = np.random.default_rng(0)
        plain = [ParsedPrompt(noun) for noun in NOUNS]
        prompts = list(dict.fromkeys(self.prompts))
        ranks: dict[str, list[tuple[bool, float]]] = {"among 12": [], "nouns and variants": [], "variants": []}
        for row, prompt in enumerate(self.prompts):
            twelve = [prompts[k] for k in rng.permutation(len(prompts))[:12] if prompts[k] != prompt][:11]
            ranks["among 12"].append(self.retrieves(row, twelve))
            if not self.data.other[row]:
                ranks["nouns and variants"].append(self.retrieves(row, plain + variants(prompt.noun)))
                ranks["variants"].append(self.retrieves(row, variants(prompt.noun)))
        count = np.array([len(prompt.attributes) for prompt in self.prompts])
        table = {name: np.array(pairs, float) for name, pairs in ranks.items() if pairs}
        return {
            name: [*(float(view_set[count == k, 0].mean()) for k in range(3)), *view_set.mean(0).tolist()]
            for name, view_set in table.items()
        }


def _share(hits: Tensor) -> float:
    return float(hits.float().mean())


def _calibration_error(probabilities: Tensor, noun: Tensor) -> float:
    """Return the expected calibration error in ten bins of confidence (Guo et al. 2017, eq. 3)."""
    confidence, guess = probabilities.max(1)
    right = (guess == noun).float()
    bins = (confidence * 10).long().clamp_max(9)
    gaps = [
        (bins == k).float().mean() * (right - confidence)[bins == k].mean().abs() for k in sorted(set(bins.tolist()))
    ]
    return float(torch.stack(gaps).sum())


def _report(name: str, network: JudgeNetwork, data: ViewSet) -> None:
    measured = _Measured(network, data)
    probabilities = measured.noun_probabilities()
    guess = probabilities.argmax(1)
    print(f"\n{name}: {len(data)} held-out members")
    print(f"  noun of {len(NOUNS)}, top-1: one view {measured.nouns_of_views():.3f}, "
          f"eight views {_share(guess == data.noun):.3f}")  # fmt: skip
    print(
        f"  mean confidence {_share(probabilities.max(1).values):.3f}, "
        f"expected calibration error {_calibration_error(probabilities, data.noun):.3f}"
    )
    print("  whole prompt, top-1:          none    one    two    all  confidence")
    for candidates, shares in measured.retrieval().items():
        print(f"    {candidates:<25}" + "".join(f"{share:7.3f}" for share in shares))
    names = list(NOUNS)
    wrong = Counter(
        (names[was], names[answer])
        for was, answer in zip(data.noun.tolist(), guess.tolist(), strict=True)
        if was != answer
    )  # fmt: skip
    print("  confused: " + ", ".join(f"{was} as {answer} {n}" for (was, answer), n in wrong.most_common(16)))
    of_noun = Counter(names[was] for was in data.noun.tolist())
    lost = Counter({noun: sum(n for (was, _), n in wrong.items() if was == noun) for noun in of_noun})
    print("  least often found: " + ", ".join(f"{noun} {of_noun[noun] - n}/{of_noun[noun]}"
                                              for noun, n in lost.most_common(10)))  # fmt: skip


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(
        prog="python -m training.judge.measure", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--members", type=int, default=8, help="held-out members of each noun and source")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--collections", type=Path, help="what training.collections.scan wrote: held-out members of it")
    parser.add_argument("--threads", type=int, help="CPU threads")
    arguments = parser.parse_args()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    network, metadata = read_judge(arguments.weights)
    parameters = sum(parameter.numel() for parameter in network.parameters())
    print(f"{parameters} parameters, {arguments.weights.stat().st_size} bytes, {metadata['steps']} steps")
    print(f"sharpness: nouns {float(network.noun_sharpness):.2f}, prompts {float(network.prompt_sharpness):.2f}")
    real = RealShapes(arguments.collections, collections.HELD_OUT) if arguments.collections else None
    for name, rough in (("as built", False), ("roughened", True)):
        for source, prefix in _SOURCES.items():
            nouns = [noun for noun in NOUNS if noun in ((real or ()) if prefix == "real " else FAMILIES)]
            view_sets = [
                ViewSet.drawn(HELD_OUT, prefix + noun, arguments.members, rough=rough, real=real) for noun in nouns
            ]
            if view_sets:
                _report(f"{name}, {source}", network, ViewSet.joined(view_sets))
    judge = Judge(arguments.weights)
    plain = [str(ParsedPrompt(noun)) for noun in NOUNS]
    print("\nshapes that are no noun: the three likeliest nouns; the likeliest of the prompts without attributes")
    for name, mesh in SHAPES.items():
        best = sorted(judge.noun_probabilities(mesh).items(), key=lambda item: -item[1])[:3]
        prompt = torch.softmax(judge.log_likelihoods(mesh, plain), 0).max(0)
        print(
            f"  {name:<9}" + ", ".join(f"{noun} {share:.2f}" for noun, share in best),
            f"; {plain[int(prompt.indices)]} {float(prompt.values):.2f}",
        )


if __name__ == "__main__":
    main()
