"""Render the judge's training views: family members that the prior never saw, and shapes that are no noun.

The families are those of the prior, but not the members: seeds begin with a constant of the judge. Attributes are drawn
from all pairs that the grammar accepts. Meshes are smoothed and roughened before rendering, because a deformed sphere
is smoother than joined parts, and lumpier.

Source of the shapes that are no noun: Hendrycks et al. 2019, Deep anomaly detection with outlier exposure.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.torch import load_file, save_file
from scipy import sparse
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.network import encoded
from meshdeform.judge.views import VIEW_SIZE, draw_views, judging_cameras, training_cameras
from meshdeform.priors.builtin.grammar import ADJECTIVES, ATTRIBUTES, NOUNS, PARTS, Attribute, ParsedPrompt
from meshdeform.priors.builtin.training.dataset import drawn_from
from meshdeform.priors.builtin.training.families import Part, member
from meshdeform.priors.builtin.training.families.parts import box, ellipsoid, join, limb, normalised

__all__ = ["CALIBRATION", "HELD_OUT", "TRAINING", "ViewSet", "draw_member", "draw_nothing", "roughened", "seeded"]

_log = logging.getLogger(__name__)

_SEED = 0x6A756467
"""First word of every seed of the judge ("judg"); seeds of the prior begin with a small number."""

TRAINING, CALIBRATION, HELD_OUT = 0, 1, 2
"""Three disjoint ranges of seeds."""

_ATTRIBUTE_COUNT_ODDS = (0.4, 0.42, 0.18)
"""Odds of none, one and two attributes."""


def seeded(split: int, kind: int, number: int) -> np.random.Generator:
    """Return the generator of one member of the range `split`; `kind` is the noun's number (-1: no noun)."""
    return np.random.default_rng([_SEED, split, kind + 1, number])


def _draw_prompt(noun: str, rng: np.random.Generator) -> ParsedPrompt:
    """Draw a prompt about a noun with up to two compatible attributes."""
    known = [Attribute("whole", word) for word in ADJECTIVES]
    known += [Attribute(part, degree) for part in NOUNS[noun] for degree in PARTS[part]]
    return drawn_from(noun, known, _ATTRIBUTE_COUNT_ODDS, rng)


def draw_member(noun: str, rng: np.random.Generator) -> tuple[ParsedPrompt, Part]:
    """Draw a member of the noun's family; return its true prompt and the mesh."""
    prompt = _draw_prompt(noun, rng)
    return prompt, member(noun, prompt.attributes, rng)


def draw_nothing(rng: np.random.Generator) -> Part:
    """Draw a shape that is no noun: a ball, a block, a bar, or up to three of them joined, often lumpy."""
    parts = []
    for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
        place = rng.uniform(-0.5, 0.5, 3)
        match int(rng.integers(3)):
            case 0:
                parts.append(ellipsoid(place, np.exp(rng.uniform(-0.7, 0.3, 3)) if rng.random() < 0.6 else 1.0))
            case 1:
                parts.append(box(place, np.exp(rng.uniform(-0.7, 0.7, 3)), round_by=float(rng.uniform(0.02, 0.5))))
            case _:
                parts.append(limb([place, place + rng.normal(0.0, 0.8, 3)], rng.uniform(0.15, 0.6, 2)))
    shape = normalised(join(parts))
    return normalised(Part(_waved(shape.verts, rng, float(rng.choice([0.0, rng.uniform(0.05, 0.3)]))), shape.faces))


def _waved(verts: NDArray[np.float64], rng: np.random.Generator, amplitude: float) -> NDArray[np.float64]:
    """Displace by a smooth random field: six plane waves, wavelengths from the radius to a quarter of it."""
    wave = rng.normal(0.0, 1.0, (6, 3))
    wave *= (2 * np.pi / rng.uniform(0.25, 1.2, 6) / np.linalg.norm(wave, axis=1))[:, None]
    direction = rng.normal(0.0, 1.0, (6, 3)) / np.sqrt(18.0)
    phase = rng.uniform(0.0, 2 * np.pi, 6)
    # Longer waves are higher, as in results of an optimisation.
    direction *= (6.0 / np.linalg.norm(wave, axis=1))[:, None]
    return np.asarray(verts + amplitude * np.sin(verts @ wave.T + phase) @ direction)


def roughened(shape: Part, rng: np.random.Generator) -> Part:
    """Smooth, wave, perturb and slightly tilt a shape, to resemble the result of an optimisation."""
    verts = shape.verts
    if rng.random() < 0.5:
        verts = _smoothed(Part(verts, shape.faces), int(rng.integers(1, 5)))
    if rng.random() < 0.7:
        verts = _waved(verts, rng, float(rng.uniform(0.0, 0.12)))
    if rng.random() < 0.3:
        verts = verts + rng.normal(0.0, rng.uniform(0.0, 0.008), verts.shape)
    tilt = rng.normal(0.0, np.radians(3.0), 2)
    verts = np.stack([verts[:, 0] - tilt[0] * verts[:, 1], verts[:, 1] + verts[:, [0, 2]] @ tilt,
                      verts[:, 2] - tilt[1] * verts[:, 1]], 1)  # fmt: skip
    return Part(verts, shape.faces)


def _smoothed(shape: Part, times: int) -> NDArray[np.float64]:
    """Smooth uniformly: move every vertex half way to the mean of its neighbours, `times` times."""
    start, stop = shape.faces[:, [0, 1, 2]].ravel(), shape.faces[:, [1, 2, 0]].ravel()
    count = len(shape.verts)
    graph = sparse.csr_matrix((np.ones(len(start)), (start, stop)), shape=(count, count))
    degree = np.maximum(np.asarray(graph.sum(1)), 1.0)
    verts = shape.verts
    for _ in range(times):
        verts = np.asarray(0.5 * verts + 0.5 * (graph @ verts) / degree)
    return verts


@dataclass(frozen=True)
class ViewSet:
    """Views of M meshes with their labels.

    `images` (M, V, 64, 64) uint8; `noun` (M,) int64, -1 for shapes that are no noun; `attributes` (M, A) uint8.
    """

    images: Tensor
    noun: Tensor
    attributes: Tensor

    def __len__(self) -> int:
        return len(self.images)

    @classmethod
    def drawn(cls, split: int, members: int, nothings: int = 0, *, rough: bool = True) -> ViewSet:
        """Draw `members` of every family and `nothings` shapes that are no noun.

        The training range is rendered from four random cameras, the others from the judge's eight cameras.
        """
        kinds = [(kind, number) for kind in range(len(NOUNS)) for number in range(members)]
        kinds += [(-1, number) for number in range(nothings)]
        images = torch.empty(len(kinds), 4 if split == TRAINING else 8, VIEW_SIZE, VIEW_SIZE, dtype=torch.uint8)
        attributes = torch.zeros(len(kinds), len(ATTRIBUTES), dtype=torch.uint8)
        names = list(NOUNS)
        for row, (kind, number) in enumerate(kinds):
            rng = seeded(split, kind, number)
            if kind < 0:
                shape = draw_nothing(rng)
            else:
                prompt, shape = draw_member(names[kind], rng)
                attributes[row] = encoded([prompt]).attributes[0].to(torch.uint8)
            if rough:
                shape = roughened(shape, rng)
            mesh = TriangleMesh(torch.from_numpy(shape.verts), torch.from_numpy(shape.faces))
            cameras = (training_cameras(rng),) if split == TRAINING else judging_cameras()
            images[row] = (draw_views(mesh, *cameras)[:, 0] * 255.0).round().to(torch.uint8)
            if row % 1000 == 999:
                _log.info("drew %d of %d meshes", row + 1, len(kinds))
        return cls(images, torch.tensor([kind for kind, _ in kinds]), attributes)

    @classmethod
    def cached(cls, path: Path, split: int, members: int, nothings: int = 0) -> ViewSet:
        """Read the set from `path`, or draw it and write it there."""
        if path.is_file():
            held = cls(**load_file(path))
            if len(held) == len(NOUNS) * members + nothings and held.attributes.shape[1] == len(ATTRIBUTES):
                return held
            _log.warning("%s contains another set and is replaced", path)
        drawn = cls.drawn(split, members, nothings)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        save_file({"images": drawn.images, "noun": drawn.noun, "attributes": drawn.attributes}, part)
        part.replace(path)
        return drawn
