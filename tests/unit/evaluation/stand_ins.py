"""Judges that stand in for the real one in the benchmark's tests: they go by height."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.vocabulary.grammar import parse


class HeightJudge:
    """Finds the i-th of P prompts best where the mesh is about 1 + i / P times as tall as wide."""

    identity = {"id": "height", "revision": "1", "sha256": "0" * 64}  # noqa: RUF012

    def log_likelihoods(self, mesh: TriangleMesh, prompts: Sequence[str]) -> NDArray[np.float32]:
        for prompt in prompts:
            parse(prompt)
        extent = np.ptp(mesh.verts, axis=0)
        wanted = 1 + np.arange(len(prompts)) / len(prompts)
        return np.asarray(-20 * (extent[1] / extent[0] - wanted) ** 2, np.float32)

    def noun_probabilities(self, mesh: TriangleMesh) -> dict[str, float]:
        return {noun: 0.5 if noun == "mushroom" else 0.5 / (len(NOUNS) - 1) for noun in NOUNS}
