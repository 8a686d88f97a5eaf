"""Score how well each of several prompts fits a mesh, in the judge's own views.

The views are clay on white, one channel, 64 pixels per view. They differ from the prior's views, which have face
normals as colours, elevations of 0 to 30 degrees and a field of view of 30 to 45 degrees: these are from below and
above these elevations, with a narrower field of view, smoothly shaded clay and one view per picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.network import WEIGHTS, encoded, read_judge
from meshdeform.priors.builtin.grammar import NOUNS, parse
from meshdeform.priors.builtin.weights_file import file_sha256
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle

__all__ = ["NUM_VIEWS", "VIEW_SIZE", "Judge", "draw_views", "framed", "judging_cameras", "training_cameras"]

VIEW_SIZE = 64
NUM_VIEWS = 8
_STYLE = RenderStyle(view_size=VIEW_SIZE, supersample=2, shading="lambert", background=(0.0, 0.0, 0.0))
_FOV_DEG = (20.0, 28.0)
_FROM_BELOW_DEG = (-25.0, -8.0)
_FROM_ABOVE_DEG = (36.0, 58.0)


def judging_cameras() -> tuple[Cameras, Cameras]:
    """Return the eight fixed cameras: azimuths 0, 90, ... from 15 degrees below, 45, 135, ... from 45 degrees above.

    Quarter turns of the mesh about the vertical axis only permute the views.
    """
    return fixed_cameras(0.0, -15.0, 24.0), fixed_cameras(45.0, 45.0, 24.0)


def training_cameras(rng: np.random.Generator) -> Cameras:
    """Draw four cameras a quarter turn apart at a random azimuth, two from below and two from above."""
    elevations = [float(rng.uniform(*band)) for band in (_FROM_BELOW_DEG, _FROM_ABOVE_DEG) * 2]
    order = rng.permutation(4)
    azimuth, fov = float(rng.uniform(-180.0, 180.0)), float(rng.uniform(*_FOV_DEG))
    return fixed_cameras(azimuth, tuple(elevations[k] for k in order), fov)


def framed(mesh: TriangleMesh) -> Tensor:
    """Centre the vertices (V, 3) float64 on the bounding box of the surface and scale them into the unit sphere.

    Unused vertices do not affect the box.

    Raises
    ------
    ShapeError
        There are no faces, the surface is a single point, or a position is not finite.
    """
    used = mesh.verts[mesh.faces.reshape(-1)]
    if not used.numel() or not bool(used.isfinite().all()):
        raise ShapeError("the judge needs a mesh with faces and finite positions")
    centre = (used.amin(0) + used.amax(0)) / 2
    radius = (used - centre).norm(dim=1).max()
    if not float(radius) > 0:
        raise ShapeError("the judge needs a mesh with an extent, but all vertices are one point")
    placed: Tensor = (mesh.verts - centre) / radius
    return placed


@torch.no_grad()
def draw_views(mesh: TriangleMesh, *cameras: Cameras) -> Tensor:
    """Render the framed mesh from all cameras.

    Returns
    -------
    (N, 1, 64, 64) float32 in [0, 1]: 1 is background. On the surface, 0 faces the light and 0.75 is in shade, so
    shading is never mistaken for background.
    """
    verts = framed(mesh)
    renderer = Renderer(mesh.faces, len(verts), _STYLE)
    images = torch.cat([renderer.render(verts, group)[..., :1] for group in cameras])
    return (1.0 - images.permute(0, 3, 1, 2)).clamp(0.0, 1.0)


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
