"""Tell which noun a mesh looks like, in the judge's own views.

The views are clay on white, one channel, 64 pixels per view. They differ from the prior's views, which have face
normals as colours, elevations of 0 to 30 degrees and a field of view of 30 to 45 degrees: these are from below and
above these elevations, with a narrower field of view, smoothly shaded clay and one view per picture.

The network is a small residual one that classifies a single view. The mean of the logits of several views, times a
sharpness that was fitted on real assets, gives the probabilities. The weights are half precision safetensors that
record their vocabulary.

Sources: He et al. 2016 (residual networks), Guo et al. 2017 (the sharpness is the inverse of their temperature).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from meshdeform.errors import ModelError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.priors.builtin.network import file_sha256
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.vocabulary.grammar import parse

VIEW_SIZE = 64
_STYLE = RenderStyle(view_size=VIEW_SIZE, supersample=2, shading="lambert", background=(0.0, 0.0, 0.0))
_FOV_DEG = (20.0, 28.0)
_FROM_BELOW_DEG = (-25.0, -8.0)
_FROM_ABOVE_DEG = (36.0, 58.0)


@dataclass(frozen=True)
class JudgeConfig:
    """Sizes of the network, whose defaults are those of the shipped weights, and the nouns that it tells apart."""

    nouns: tuple[str, ...]
    stem: int = 24
    channels: tuple[int, int, int] = (48, 96, 128)


class _Block(nn.Module):
    """Two 3 x 3 convolutions that halve the picture, with a 1 x 1 convolution as shortcut."""

    def __init__(self, inner: int, outer: int) -> None:
        super().__init__()
        self.conv_in = nn.Conv2d(inner, outer, 3, stride=2, padding=1, bias=False)
        self.norm_in = nn.BatchNorm2d(outer)
        self.conv_out = nn.Conv2d(outer, outer, 3, padding=1, bias=False)
        self.norm_out = nn.BatchNorm2d(outer)
        self.skip = nn.Conv2d(inner, outer, 1, stride=2, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, inner, H, W) to (B, outer, H / 2, W / 2)."""
        h = torch.relu(self.norm_in(self.conv_in(x)))
        return torch.relu(self.skip(x) + self.norm_out(self.conv_out(h)))


class JudgeNetwork(nn.Module):
    """Network that classifies single views."""

    sharpness: Tensor

    def __init__(self, config: JudgeConfig) -> None:
        super().__init__()
        self.config = config
        c0, (c1, c2, c3) = self.config.stem, self.config.channels
        self.stem = nn.Sequential(nn.Conv2d(1, c0, 5, stride=2, padding=2, bias=False), nn.BatchNorm2d(c0), nn.ReLU())
        self.blocks = nn.Sequential(_Block(c0, c1), _Block(c1, c2), _Block(c2, c3))
        self.noun_head = nn.Linear(c3, len(config.nouns))
        # A factor of the mean over the views: views of one mesh are correlated, so their sum would be overconfident.
        self.register_buffer("sharpness", torch.ones(()))

    def forward(self, images: Tensor) -> Tensor:
        """Return the logits (B, N) float32 of the nouns for views (B, 1, 64, 64) float32 from `draw_views`."""
        features = self.blocks(self.stem(images * 2.0 - 1.0)).mean((2, 3))
        logits: Tensor = self.noun_head(features).float()
        return logits


WEIGHTS = Path(__file__).parent / "weights" / "judge.safetensors"

_ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: python -m training.judge.train."
)


def read_judge(path: Path = WEIGHTS) -> tuple[JudgeNetwork, dict[str, str]]:
    """Read the network in float32 for inference, and the file's metadata.

    Raises
    ------
    ModelError
        The file is missing, not safetensors, or of another network.
    """
    if not path.is_file():
        raise ModelError(f"The judge's weights are missing: there is no {path.name} in {path.parent}.", advice=_ADVICE)
    try:
        with safe_open(path, framework="pt") as file:
            metadata = dict(file.metadata() or {})
            state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise ModelError(f"The judge's weights in {path} cannot be read: {error}.", advice=_ADVICE) from error
    try:
        config = json.loads(metadata["config"])
        network = JudgeNetwork(JudgeConfig(tuple(config["nouns"]), config["stem"], tuple(config["channels"])))
        missing, strange = network.load_state_dict(state, strict=False)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise ModelError(f"The judge's weights in {path} are of another network.", advice=_ADVICE) from error
    if strange or [name for name in missing if not name.endswith("num_batches_tracked")]:
        raise ModelError(f"The judge's weights in {path} are of another network.", advice=_ADVICE)
    network.eval().requires_grad_(requires_grad=False)
    return network, metadata


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
    verts = verts_of(mesh)
    used = verts[faces_of(mesh).reshape(-1)]
    if not used.numel() or not bool(used.isfinite().all()):
        raise ShapeError("the judge needs a mesh with faces and finite positions")
    centre = (used.amin(0) + used.amax(0)) / 2
    radius = (used - centre).norm(dim=1).max()
    if not float(radius) > 0:
        raise ShapeError("the judge needs a mesh with an extent, but all vertices are one point")
    placed: Tensor = (verts - centre) / radius
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
    renderer = Renderer(faces_of(mesh), len(verts), _STYLE)
    images = torch.cat([renderer.render(verts, group)[..., :1] for group in cameras])
    return (1.0 - images.permute(0, 3, 1, 2)).clamp(0.0, 1.0)


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
        self._network, metadata = read_judge(weights)
        self.nouns = self._network.config.nouns
        self._cameras = judging_cameras()
        self.identity: dict[str, str] = {
            "id": "judge",
            "revision": f"{metadata.get('steps', '?')} steps, seed {metadata.get('seed', '?')}",
            "sha256": file_sha256(weights),
        }

    def log_likelihoods(self, mesh: TriangleMesh, prompts: Sequence[str]) -> Tensor:
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

    def noun_probabilities(self, mesh: TriangleMesh) -> dict[str, float]:
        """Return the probability of each noun that it knows if all are equally likely beforehand; they sum to 1.

        Raises
        ------
        ShapeError
            As in `log_likelihoods`.
        """
        return dict(zip(self.nouns, torch.softmax(self._scores(mesh), 0).tolist(), strict=True))

    @torch.no_grad()
    def _scores(self, mesh: TriangleMesh) -> Tensor:
        logits: Tensor = self._network(draw_views(mesh, *self._cameras))
        return logits.mean(0) * self._network.sharpness
