"""Score how well each of several prompts fits a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.network import encoded
from meshdeform.judge.views import draw_views, judging_cameras
from meshdeform.judge.weights_file import WEIGHTS, read_judge
from meshdeform.priors.builtin.grammar import NOUNS, parse
from meshdeform.priors.builtin.weights_file import file_sha256

__all__ = ["Judge"]


class Judge:
    """Classifier of meshes that shares only the vocabulary with the builtin prior.

    Parameters
    ----------
    weights : pathlib.Path
        A file written by `train`; by default the one in the package.

    Attributes
    ----------
    identity : dict of str
        `id`, `revision` and `sha256` of the weights, for reports.

    Raises
    ------
    ModelError
        The weights are missing, unreadable or of another vocabulary.
    """

    def __init__(self, weights: Path = WEIGHTS) -> None:
        self._network, metadata = read_judge(weights)
        self._cameras = judging_cameras()
        self.identity: dict[str, str] = {
            "id": "judge",
            "revision": f"{metadata.get('steps', '?')} steps, seed {metadata.get('seed', '?')}",
            "sha256": file_sha256(weights),
        }

    @torch.no_grad()
    def log_likelihoods(self, mesh: TriangleMesh, prompts: Sequence[str]) -> Tensor:
        """Score how well each prompt fits the mesh.

        Parameters
        ----------
        mesh : TriangleMesh
            +Y up, of any position, size and heading.
        prompts : sequence of P str
            Prompts of the builtin prior's grammar.

        Returns
        -------
        (P,) float32: log p(mesh | prompt) up to a constant of the mesh. A softmax over the prompts gives the
        probability of each if all are equally likely beforehand; the largest score is retrieved.

        Raises
        ------
        PromptError, VocabularyError
            A prompt is outside the grammar.
        ShapeError
            The mesh has no faces, no extent or positions that are not finite.
        """
        asked = encoded([parse(prompt) for prompt in prompts])
        noun_logits, features = self._network.encode_views(draw_views(mesh, *self._cameras))
        return self._network.scores(noun_logits, features, asked).mean(0) * self._network.prompt_sharpness

    @torch.no_grad()
    def noun_probabilities(self, mesh: TriangleMesh) -> dict[str, float]:
        """Return the probability of each noun of the vocabulary, for any attributes; they sum to 1.

        Raises
        ------
        ShapeError
            As in `log_likelihoods`.
        """
        noun_logits, _ = self._network.encode_views(draw_views(mesh, *self._cameras))
        probabilities = torch.softmax(noun_logits.mean(0) * self._network.noun_sharpness, 0)
        return dict(zip(NOUNS, probabilities.tolist(), strict=True))
