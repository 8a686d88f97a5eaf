"""Measure the effect of negative prompts: ``python -m bench.negative_prompts [--steps N] [--source NAME]``.

For pairs of opposite attributes of a noun, the source is deformed with the noun as prompt and three negative prompts:
none, the noun with the first attribute, and with the second. For every result, the builtin judge, which shares only the
vocabulary with the prior, gives the log likelihood ratio of the two attributes, in nats. An effective negative prompt
moves it towards the other attribute.
"""

from __future__ import annotations

import argparse

import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.priors import load_prior
from meshdeform.rendering.cameras import Frame
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.groups import grouped
from meshdeform.runs.goals import score_distillation
from training.evaluation.measures import measures
from training.evaluation.retrieval import load_judge
from training.evaluation.sources import source_mesh

PAIRS = (
    ("a vase", "a tall vase", "a short vase"),
    ("a penguin", "a fat penguin", "a thin penguin"),
    ("a rabbit", "a rabbit with big ears", "a rabbit with small ears"),
    ("a dinosaur", "a dinosaur with a long neck", "a dinosaur with a short neck"),
    ("a mushroom", "a mushroom with a big cap", "a mushroom with a small cap"),
    ("a rocket", "a rocket with big fins", "a rocket with small fins"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--source", default="sphere")
    parser.add_argument("--dirichlet-weight", type=float, help="default: the preset's")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    prior, judge, rest = load_prior("builtin", device="cpu"), load_judge("builtin"), source_mesh(arguments.source)
    assert judge is not None
    frame = Frame.around(rest.verts)

    def deformed(prompt: str, **options: object) -> TriangleMesh:
        params = resolve(
            DeformParams.model_validate(
                grouped({"steps": arguments.steps, "dirichlet_weight": arguments.dirichlet_weight, **options})
            )
        )
        deformation = Deformation(frame.place(rest), score_distillation(prior, prompt, params), params)
        for _ in deformation:
            pass
        return TriangleMesh(frame.leave(deformation.verts()), rest.faces)

    print("| prompt | rather than | none | the first | the second | flipped, cut |")
    print("|---|---|---|---|---|---|")
    for prompt, first, second in PAIRS:
        shapes = [deformed(prompt), *(deformed(prompt, negative_prompt=text) for text in (first, second))]
        scores = [judge.log_likelihoods(shape, [first, second]).tolist() for shape in shapes]
        found = [measures(rest, shape) for shape in shapes]
        bad = [sum(quality[name] for quality in found) for name in ("flipped_faces", "self_intersections_added")]
        sides = " | ".join(f"{one - other:+.1f}" for one, other in scores)
        print(f"| {first} | {second} | {sides} | {bad[0]:.0f}, {bad[1]:.0f} |", flush=True)


if __name__ == "__main__":
    main()
