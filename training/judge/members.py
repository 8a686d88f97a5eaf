"""Render the judge's training views: members that the prior never saw, and shapes that are no noun.

Members have two sources. Some are of the prior's families, though not the prior's members: seeds begin with a constant
of the judge, and attributes are drawn from all pairs that the grammar accepts. The others are made by the judge's own
code (`shapes`), so that it is not the prior's mirror. Meshes are smoothed and roughened before rendering, because a
deformed sphere is smoother than joined parts, and lumpier; some get flat facets, as assets of kits have.

Source of the shapes that are no noun: Hendrycks et al. 2019, Deep anomaly detection with outlier exposure.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from scipy import sparse
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge.scoring import VIEW_SIZE, draw_views, encoded, judging_cameras, training_cameras
from meshdeform.nouns.families import FAMILIES, Part, member
from meshdeform.nouns.families.parts import box, ellipsoid, join, limb
from meshdeform.priors.builtin.grammar import ATTRIBUTES, Attribute, ParsedPrompt
from meshdeform.priors.builtin.teaching.deformed import normalised
from meshdeform.priors.builtin.teaching.views import drawn_from
from meshdeform.priors.builtin.vocabulary import ADJECTIVES, NOUNS, PARTS
from training.collections.members import RealShapes
from training.judge import shapes

_log = logging.getLogger(__name__)

_SEED = 0x6A756467
"""First word of every seed of the judge ("judg"); seeds of the prior begin with a small number."""

TRAINING, CALIBRATION, HELD_OUT = 0, 1, 2
"""Three disjoint ranges of seeds."""

_ATTRIBUTE_COUNT_ODDS = (0.4, 0.42, 0.18)
"""Odds of none, one and two attributes."""
_OTHERS_COUNT_ODDS = (0.6, 0.32, 0.08)
"""The same of members by the judge's own code."""


def seeded(split: int, kind: str, number: int) -> np.random.Generator:
    """Return the generator of one member of the range `split`; `kind` is a noun, or what `ViewSet.drawn` names."""
    return np.random.default_rng([_SEED, split, int.from_bytes(hashlib.sha256(kind.encode()).digest()[:8]), number])


def draw_member(noun: str, rng: np.random.Generator) -> tuple[ParsedPrompt, Part]:
    """Draw a member of the noun's family with up to two attributes; return its true prompt and the mesh."""
    known = [Attribute("whole", word) for word in ADJECTIVES]
    known += [Attribute(part, degree) for part in NOUNS[noun] for degree in PARTS[part]]
    prompt = drawn_from(noun, known, _ATTRIBUTE_COUNT_ODDS, rng)
    return prompt, member(noun, prompt.attributes, rng)


def draw_other(noun: str, rng: np.random.Generator) -> tuple[ParsedPrompt, Part]:
    """Draw a noun by the judge's own code with up to two attributes of the whole; return its prompt and the mesh.

    The sizes of its parts are not known, so the prompt says nothing of them.
    """
    prompt = drawn_from(noun, [Attribute("whole", word) for word in ADJECTIVES], _OTHERS_COUNT_ODDS, rng)
    return prompt, shapes.drawn(noun, prompt.attributes, rng)


def draw_real(noun: str, rng: np.random.Generator, real: RealShapes) -> tuple[ParsedPrompt, Part]:
    """Draw a noun from collections with up to two attributes of the whole; return its prompt and the mesh."""
    prompt = drawn_from(noun, [Attribute("whole", word) for word in ADJECTIVES], _OTHERS_COUNT_ODDS, rng)
    return prompt, real.draw(noun, prompt.attributes, rng)


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
    """Views of M meshes with their labels.

    `images` (M, V, 64, 64) uint8; `noun` (M,) int64, -1 for shapes that are no noun; `attributes` (M, A) uint8;
    `other` (M,) bool: made by the judge's own code, so that the sizes of parts are not known.
    """

    images: Tensor
    noun: Tensor
    attributes: Tensor
    other: Tensor

    def __len__(self) -> int:
        return len(self.images)

    def rows(self, rows: Tensor) -> ViewSet:
        """Return some meshes of the set."""
        return ViewSet(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def joined(cls, sets: Sequence[ViewSet]) -> ViewSet:
        """Join sets."""
        return cls(*(torch.cat([getattr(each, field.name) for each in sets]) for field in fields(cls)))

    @classmethod
    def drawn(
        cls, split: int, kind: str, members: int, *, first: int = 0, rough: bool = True, real: RealShapes | None = None
    ) -> ViewSet:
        """Draw `members` of a kind, from number `first` on.

        A kind is a noun (its family), "other " and a noun (the judge's own code), "real " and a noun, or "nothing".

        The training range is rendered from four random cameras, the others from the judge's eight cameras.
        """
        other, noun = kind.startswith(("other ", "real ")), kind.split()[-1]
        number_of = {name: number for number, name in enumerate(NOUNS)}
        images = torch.empty(members, 4 if split == TRAINING else 8, VIEW_SIZE, VIEW_SIZE, dtype=torch.uint8)
        attributes = torch.zeros(members, len(ATTRIBUTES), dtype=torch.uint8)
        for row in range(members):
            prompt, shape, rng = _drawn_shape(split, kind, first + row, real)
            if prompt is not None:
                attributes[row] = encoded([prompt]).attributes[0].to(torch.uint8)
            if rough:
                shape = roughened(shape, rng)
                if rng.random() < (0.3 if other else 0.1):
                    shape = faceted(shape)
            mesh = TriangleMesh(torch.from_numpy(shape.verts), torch.from_numpy(shape.faces))
            cameras = (training_cameras(rng),) if split == TRAINING else judging_cameras()
            images[row] = (draw_views(mesh, *cameras)[:, 0] * 255.0).round().to(torch.uint8)
        nouns = torch.full((members,), -1 if kind == NOTHING else number_of[noun])
        return cls(images, nouns, attributes, torch.full((members,), other))

    @classmethod
    def of_all(cls, split: int, counts: Mapping[str, int], real: RealShapes | None = None) -> ViewSet:
        """Draw so many of each kind (`counts_of`)."""
        return cls.joined([cls.drawn(split, kind, count, real=real) for kind, count in counts.items()])

    @classmethod
    def cached(cls, folder: Path, counts: Mapping[str, int], real: RealShapes | None = None) -> ViewSet:
        """Read training views from a folder with a file for each kind; draw what is missing or was drawn otherwise.

        A kind is drawn anew if its first members differ from those of its file, and its file is continued if it has
        too few.
        """
        folder.mkdir(parents=True, exist_ok=True)
        sets = []
        for kind, count in counts.items():
            path, recipe = folder / f"{kind.replace(' ', '.')}.safetensors", _recipe(kind, real)
            view_set = cls(**load_file(path)) if _stored_recipe(path) == recipe else cls.drawn(TRAINING, kind, 0)
            if len(view_set) < count:
                more = cls.drawn(TRAINING, kind, count - len(view_set), first=len(view_set), real=real)
                view_set = cls.joined([view_set, more])
                part = path.with_suffix(".part")
                save_file({field.name: getattr(view_set, field.name) for field in fields(cls)}, part, recipe)
                part.replace(path)
                _log.info("drew %s, %d in all", kind, count)
            # Numbers of nouns are those of today's vocabulary.
            number = -1 if kind == NOTHING else list(NOUNS).index(kind.split()[-1])
            sets.append(replace(view_set.rows(torch.arange(count)), noun=torch.full((count,), number)))
        return cls.joined(sets)


NOTHING = "nothing"
"""The kind of shapes that are no noun."""
_TOLD_MEMBERS = 2
"""Members whose shapes are part of a recipe: enough to notice that a family was changed."""


def counts_of(
    nouns: Sequence[str], members: int, neighbours: int, nothings: int = 0, real: RealShapes | None = None
) -> dict[str, int]:
    """Return how many of each kind to draw: as many real members as of the family, or as of both if there is none."""
    counts = {noun: members for noun in nouns if noun in FAMILIES}
    counts |= {f"other {noun}": neighbours for noun in nouns if noun in FAMILIES}
    if real is not None:
        counts |= {f"real {noun}": members + neighbours * (noun not in FAMILIES) for noun in nouns if noun in real}
    return {kind: count for kind, count in {**counts, NOTHING: nothings}.items() if count}


def _drawn_shape(
    split: int, kind: str, number: int, real: RealShapes | None
) -> tuple[ParsedPrompt | None, Part, np.random.Generator]:
    """Draw a shape of a kind; return its prompt, None if it is no noun, and the generator that draws the rest."""
    rng, (*source, noun) = seeded(split, kind, number), kind.split()
    if kind == NOTHING:
        return None, draw_nothing(rng), rng
    if source == ["real"]:
        assert real is not None
        return *draw_real(noun, rng, real), rng
    return *(draw_other if source else draw_member)(noun, rng), rng


def _recipe(kind: str, real: RealShapes | None) -> dict[str, str]:
    """Return the fingerprint of a kind's training views."""
    digest = hashlib.sha256()
    for number in range(_TOLD_MEMBERS):
        prompt, shape, _ = _drawn_shape(TRAINING, kind, number, real)
        digest.update(str(prompt).encode())
        digest.update(np.round(shape.verts, 6).tobytes())
        digest.update(np.asarray(shape.faces, dtype=np.int64).tobytes())
    if kind.startswith("real ") and real is not None:
        digest.update(real.digest(kind.split()[-1]).encode())
    return {"kind": kind, "attributes": str(len(ATTRIBUTES)), "shapes": digest.hexdigest()}


def _stored_recipe(path: Path) -> dict[str, str]:
    if not path.is_file():
        return {}
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata() or {})
