"""Tell which noun a mesh looks like, in the judge's own views.

The views are clay on white, one channel, 64 pixels per view. They differ from the prior's views, which have face
normals as colours, elevations of 0 to 30 degrees and a field of view of 30 to 45 degrees: these are from below and
above these elevations, with a narrower field of view, smoothly shaded clay and one view per picture.

The network classifies single views. The mean of the logits of several views, times a sharpness that was fitted on real
assets, gives the probabilities.

Source: Guo et al. 2017 (the sharpness is the inverse of their temperature).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.network import WEIGHTS, Network, read_weights
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.clay import ClayRenderer
from meshdeform.support.files import file_sha256
from meshdeform.vocabulary.grammar import parse

VIEW_SIZE = 64
_SUPERSAMPLE = 2
_Floats = NDArray[np.float64]
_Singles = NDArray[np.float32]


def judging_cameras() -> Cameras:
    """Return the eight fixed cameras: azimuths 0, 90, ... from 15 degrees below, 45, 135, ... from 45 degrees above.

    Quarter turns of the mesh about the vertical axis only permute the views.
    """
    azimuths = tuple(first + 90.0 * k for first in (0.0, 45.0) for k in range(4))
    return fixed_cameras(azimuths, (-15.0,) * 4 + (45.0,) * 4, 24.0)


def framed(mesh: TriangleMesh) -> _Floats:
    """Centre the vertices (V, 3) float64 on the bounding box of the surface and scale them into the unit sphere.

    Unused vertices do not affect the box.

    Raises
    ------
    ShapeError
        There are no faces, the surface is a single point, or a position is not finite.
    """
    used = mesh.verts[np.flatnonzero(np.bincount(mesh.faces.ravel()))]
    if not used.size or not np.isfinite(used).all():
        raise ShapeError("the judge needs a mesh with faces and finite positions")
    centre = (used.min(0) + used.max(0)) / 2
    radius = float(np.linalg.norm(used - centre, axis=1).max())
    if not radius > 0:
        raise ShapeError("the judge needs a mesh with an extent, but all vertices are one point")
    return np.asarray((mesh.verts - centre) / radius)


def draw_views(mesh: TriangleMesh, cameras: Cameras) -> _Singles:
    """Render the framed mesh from all cameras.

    Returns
    -------
    (B, 64, 64) float32 in [0, 1]: 1 is background. On the surface, 0 faces the light and 0.75 is in shade, so shading
    is never mistaken for background.
    """
    images = ClayRenderer(mesh.faces, VIEW_SIZE, _SUPERSAMPLE).render(framed(mesh), cameras)
    return np.clip(1 - images, 0, 1)


class Judge:
    """Classifier of meshes, which shares nothing with the families of shapes but their nouns.

    Parameters
    ----------
    weights : pathlib.Path
        A file written by `train`; by default the one in the package.

    Attributes
    ----------
    identity : dict of str
        `id`, `revision` and `sha256` of the weights, for reports.
    nouns : tuple of str
        What it tells apart: the nouns when it was trained.

    Raises
    ------
    ModelError
        The weights are missing or unreadable.
    """

    def __init__(self, weights: Path = WEIGHTS) -> None:
        found = read_weights(weights)
        self._network, self.nouns = Network(found), found.config.nouns
        self._cameras = judging_cameras()
        self.identity: dict[str, str] = {
            "id": "judge",
            "revision": f"{found.metadata.get('steps', '?')} steps, seed {found.metadata.get('seed', '?')}",
            "sha256": file_sha256(weights),
        }

    def log_likelihoods(self, mesh: TriangleMesh, prompts: Sequence[str]) -> _Singles:
        """Score how well the noun of each prompt fits the mesh; attributes do not count.

        Parameters
        ----------
        mesh : TriangleMesh
            +Y up, of any position, size and heading.
        prompts : sequence of P str
            Prompts whose nouns it knows.

        Returns
        -------
        (P,) float32: log p(mesh | noun) up to a constant of the mesh.

        Raises
        ------
        PromptError, VocabularyError
            A prompt is outside the grammar.
        ValueError
            It does not know the noun of a prompt.
        ShapeError
            The mesh has no faces, no extent or positions that are not finite.
        """
        return self._scores(mesh)[[self.nouns.index(parse(prompt).noun) for prompt in prompts]]

    def noun_probabilities(self, mesh: TriangleMesh, *, of_public: bool = False) -> dict[str, float]:
        """Return the probability of each noun that it knows; they sum to 1.

        All nouns are equally likely beforehand, or, `of_public`, as likely as they are among public assets.

        Raises
        ------
        ShapeError
            As in `log_likelihoods`.
        """
        scores = self._scores(mesh).astype(np.float64)
        if of_public:
            scores += self._network.commonness
        shares = np.exp(scores - scores.max())
        return dict(zip(self.nouns, (shares / shares.sum()).tolist(), strict=True))

    def _scores(self, mesh: TriangleMesh) -> _Singles:
        logits = self._network.logits(draw_views(mesh, self._cameras))
        return np.asarray(logits.mean(0) * np.float32(self._network.sharpness))
