"""Say what a suite's retrieval would be if every result were a true one: the ceiling that the judge sets.

    python -m bench.suite_ceiling unseen

Draws members of the prompts' families with the prompts' attributes, roughened as an optimisation might leave them, and
has the judge retrieve the prompt among those of the suite, and the noun among all that it knows. No result of a
deformation takes part.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.teaching.teacher import interval
from meshdeform.runs.devices import use_threads
from training.evaluation.suite import find_suite
from training.judge.members import roughened
from training.prior.families import member

_SEED = 0x6365696C
"""First word of the seeds of the members ("ceil"), which neither the prior nor the judge was trained on."""


def main() -> None:
    """Run from the command line."""
    about = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m bench.suite_ceiling", description=about)
    parser.add_argument("suite")
    parser.add_argument("--members", type=int, default=3, help="of each prompt")
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    use_threads(options.threads)
    judge, prompts = Judge(), find_suite(options.suite).prompts
    retrieved = nouns = 0
    for number, prompt in enumerate(prompts):
        wanted = parse(prompt)
        own = np.zeros(2, int)
        for k in range(options.members):
            rng = np.random.default_rng([_SEED, number, k])
            part = roughened(member(wanted.noun, wanted.attributes, rng), rng)
            mesh = TriangleMesh(torch.from_numpy(part.verts), torch.from_numpy(part.faces))
            likely = judge.noun_probabilities(mesh)
            hit = prompts[int(judge.log_likelihoods(mesh, prompts).argmax())] == prompt
            own += hit, max(likely, key=likely.__getitem__) == wanted.noun
        if own.min() < options.members:
            print(f"{prompt:<32} prompt {own[0]}, noun {own[1]} of {options.members}", flush=True)
        retrieved, nouns = retrieved + own[0], nouns + own[1]
    for name, hits in (("prompt", retrieved), ("noun", nouns)):
        count = len(prompts) * options.members
        low, high = interval(int(hits), count)
        print(f"{name} retrieved: {hits} of {count}, {hits / count:.0%} ({low:.0%} to {high:.0%})")


if __name__ == "__main__":
    main()
