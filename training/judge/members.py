"""Render the views that the judge is trained and measured with: nouns by other code and of collections, and nothing.

No member of a family (`meshdeform.nouns.families`) trains it: results are fitted to them, and it would tell how much a
result resembles its goal. They are drawn to measure it alone. Meshes are smoothed and roughened before rendering,
because a deformed sphere is smoother than joined parts, and lumpier; some get flat facets, as assets of kits have.

Source of the shapes that are no noun: Hendrycks et al. 2019, Deep anomaly detection with outlier exposure.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from scipy import sparse
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.scoring import VIEW_SIZE, draw_views, judging_cameras
from meshdeform.nouns.deformed import normalised
from meshdeform.nouns.families import Part, member
from meshdeform.nouns.families.parts import box, ellipsoid, join, limb
from meshdeform.rendering.cameras import Cameras, fixed_cameras
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS
from meshdeform.vocabulary.words import ADJECTIVES
from training.collections.members import RealShapes
from training.judge import shapes
from training.prior.pictures import drawn_from

_FOV_DEG = (20.0, 28.0)
_FROM_BELOW_DEG = (-25.0, -8.0)
_FROM_ABOVE_DEG = (36.0, 58.0)
_log = logging.getLogger(__name__)

OTHER, REAL, FAMILY, NOTHING = "other", "real", "family", "nothing"
"""Where shapes come from: code of the judge's own, collections, the families; and shapes that are no noun."""

_SEED = 0x6A756467
"""First word of every seed of the judge ("judg"); seeds of the prior begin with a small number."""

TRAINING, HELD_OUT = 0, 2
"""Disjoint ranges of seeds."""

_WHOLE = [Attribute("whole", word) for word in ADJECTIVES]
_ATTRIBUTE_COUNT_ODDS = (0.6, 0.32, 0.08)
"""Odds of none, one and two attributes of the whole: a tall vase is a vase."""


def training_cameras(rng: np.random.Generator) -> Cameras:
    """Draw four cameras a quarter turn apart at a random azimuth, two from below and two from above."""
    elevations = [float(rng.uniform(*band)) for band in (_FROM_BELOW_DEG, _FROM_ABOVE_DEG) * 2]
    order = rng.permutation(4)
    azimuth, fov = float(rng.uniform(-180.0, 180.0)), float(rng.uniform(*_FOV_DEG))
    return fixed_cameras(azimuth, tuple(elevations[k] for k in order), fov)


def seeded(split: int, kind: str, number: int) -> np.random.Generator:
    """Return the generator of one member of the range `split`; `kind` as in `ViewSet.drawn`."""
    return np.random.default_rng([_SEED, split, int.from_bytes(hashlib.sha256(kind.encode()).digest()[:8]), number])


def draw_shape(kind: str, rng: np.random.Generator, real: RealShapes | None = None) -> Part:
    """Draw a shape of a kind, as it was built; `real`: needed for those of collections."""
    if kind == NOTHING:
        return draw_nothing(rng)
    source, noun = kind.split()
    attributes = drawn_from(noun, _WHOLE, _ATTRIBUTE_COUNT_ODDS, rng).attributes
    if source == REAL:
        assert real is not None
        return real.draw(noun, attributes, rng)
    return shapes.drawn(noun, attributes, rng) if source == OTHER else member(noun, attributes, rng)


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


def faceted(shape: Part) -> Part:
    """Give every face its own vertices, so that it is shaded flat."""
    return Part(shape.verts[shape.faces.ravel()], np.arange(shape.faces.size).reshape(-1, 3))


@dataclass(frozen=True)
class ViewSet:
    """Views of M meshes: `images` (M, V, 64, 64) uint8, `noun` (M,) int64, -1 for shapes that are no noun."""

    images: Tensor
    noun: Tensor

    def __len__(self) -> int:
        return len(self.images)

    def rows(self, rows: Tensor) -> ViewSet:
        """Return some meshes of the set."""
        return ViewSet(self.images[rows], self.noun[rows])

    @classmethod
    def joined(cls, sets: Sequence[ViewSet]) -> ViewSet:
        """Join sets."""
        return cls(torch.cat([each.images for each in sets]), torch.cat([each.noun for each in sets]))

    @classmethod
    def drawn(
        cls, split: int, kind: str, members: int, *, first: int = 0, rough: bool = True, real: RealShapes | None = None
    ) -> ViewSet:
        """Draw `members` of a kind, from number `first` on.

        A kind is a source and a noun ("other vase"), or "nothing". The training range is rendered from four random
        cameras, the other from the judge's eight.
        """
        images = torch.empty(members, 4 if split == TRAINING else 8, VIEW_SIZE, VIEW_SIZE, dtype=torch.uint8)
        for row in range(members):
            rng = seeded(split, kind, first + row)
            shape = draw_shape(kind, rng, real)
            if rough:
                shape = roughened(shape, rng)
                if rng.random() < _FACETED:
                    shape = faceted(shape)
            cameras = training_cameras(rng) if split == TRAINING else judging_cameras()
            images[row] = pictures(TriangleMesh(shape.verts, shape.faces), cameras)
        return cls(images, torch.full((members,), _number(kind)))

    @classmethod
    def cached(cls, folder: Path, counts: Mapping[str, int], real: RealShapes | None = None) -> ViewSet:
        """Read so many training views of each kind (`counts_of`) from a folder with a file for each; draw the others.

        A kind is drawn anew if its first members differ from those of its file, and its file is continued if it has
        too few.
        """
        folder.mkdir(parents=True, exist_ok=True)
        sets = []
        for kind, count in counts.items():
            path, recipe = folder / f"{kind.replace(' ', '.')}.safetensors", _recipe(kind, real)
            known = load_file(path)["images"] if _stored_recipe(path) == recipe else None
            first = 0 if known is None else len(known)
            if first < count:
                more = cls.drawn(TRAINING, kind, count - first, first=first, real=real).images
                known = more if known is None else torch.cat([known, more])
                part = path.with_suffix(".part")
                save_file({"images": known}, part, recipe)
                part.replace(path)
                _log.info("drew %s, %d in all", kind, count)
            assert known is not None
            sets.append(cls(known[:count], torch.full((count,), _number(kind))))
        return cls.joined(sets)


_TOLD_MEMBERS = 2
"""Members whose shapes are part of a recipe: enough to notice that code was changed."""
_FACETED = 0.3
"""Share of shapes with flat facets."""
_EACH = 12
"""Most members that are drawn of one real shape."""


def pictures(mesh: TriangleMesh, cameras: Cameras) -> Tensor:
    """Render a mesh for a set: (V, 64, 64) uint8."""
    return torch.from_numpy(np.rint(draw_views(mesh, cameras) * 255).astype(np.uint8))


def counts_of(
    nouns: Sequence[str], others: int, reals: int, nothings: int, real: RealShapes | None = None
) -> dict[str, int]:
    """Return how many of each kind to draw for training: at most `reals` of a noun's real shapes."""
    counts = {f"{OTHER} {noun}": others for noun in nouns}
    if real is not None:
        counts |= {f"{REAL} {noun}": min(reals, _EACH * real.count(noun)) for noun in nouns}
    return {kind: count for kind, count in {**counts, NOTHING: nothings}.items() if count}


def _number(kind: str) -> int:
    return -1 if kind == NOTHING else list(NOUNS).index(kind.split()[1])


def _recipe(kind: str, real: RealShapes | None) -> dict[str, str]:
    """Return the fingerprint of a kind's training views."""
    digest = hashlib.sha256()
    for number in range(_TOLD_MEMBERS):
        shape = draw_shape(kind, seeded(TRAINING, kind, number), real)
        digest.update(np.round(shape.verts, 6).tobytes())
        digest.update(np.asarray(shape.faces, dtype=np.int64).tobytes())
    if kind.startswith(REAL) and real is not None:
        digest.update(real.digest(kind.split()[1]).encode())
    return {"kind": kind, "shapes": digest.hexdigest()}


def _stored_recipe(path: Path) -> dict[str, str]:
    if not path.is_file():
        return {}
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata() or {})
