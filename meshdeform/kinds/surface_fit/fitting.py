"""Fit a field to a surface.

Each step moves small triangles of the base, one in each of its faces, so that every learned number has a gradient in
every step:

    L = mean w |f(p) - q|^2 + w_n mean w (1 - n(f) . n_q) + mean (n_s . (f(p_s) - s))^2

f(p) is the middle of a triangle and n(f) its normal, q and n_q are the projection of f(p) and its normal, and w is
between equal shares of the faces and of the area. Triangles and projections are those of a few steps, in which only
the distance along n_q counts fully.

Where both have borders, pairs of their nearest places, both ways, add their distances across the surface's border. With
anchors, also the mean |f(p_a) - s_a|^2 of places p_a of the base that belong to places s_a of the surface.

The last term is the other direction: samples s of the surface with normals n_s, and the place p_s of the base whose
image is nearest, found a few times. Without it f could leave out parts of the surface.

In the last part of a fit the tensors are rounded as the file will hold them (`network.rounded`).

Source: Noma et al. 2026, section 4; weights, triangles and schedule are measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.deformation.variables import Adam
from meshdeform.errors import CheckpointError, NumericalError
from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.geometry.surface_samples import surface_samples
from meshdeform.geometry.tensors import arrays_of, tensors_of
from meshdeform.kinds.surface_fit.base_places import border_places, places_of
from meshdeform.kinds.surface_fit.gluing import glue
from meshdeform.kinds.surface_fit.network import START, FieldNetwork, octaves_of, rounded, steps_of
from meshdeform.kinds.surface_fit.patches import level_of, patch
from meshdeform.kinds.surface_fit.surface_sources import SourceSurface

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_PARTS = 8
"""A triangle's edges are an eighth of those of its face."""
_AGAIN = 5
"""Steps with the same triangles and projections."""
_ALONG = 0.05
"""Weight of the distance along the surface, beside that to it."""
_NORMAL = 2e-4
"""Weight of the normals beside squared distances, of a diagonal of 2."""
_OTHER_AT = (0.0, 0.1, 0.25, 0.5, 0.75)
"""Shares of a fit at which the places of the base are found that belong to samples of the surface."""
_OTHER_SAMPLES = 8192
_OTHER_BATCH = 1024
_BORDER_BATCH = 512
_BORDER = 0.3
"""Weight of the distance between borders, beside that of the surfaces."""
_FOLDED, _SETTLED, _STEPS, _LEFT, _UNFOLD = 0.02, 0.2, 10, 0.005, 300
"""A fit is folded with such a share of triangles reversed, after such a share of the fit, in so many steps after each
other; the share that may stay, and how much more normals count at twice that. A base of another shape unfolds only so;
others are fitted less well."""
_RATE, _OF_FEATURES = 0.02, 6.0
"""Adam's rate of the layers at its highest, and how many times as fast features are learned."""
_WARM_STEPS = 20
_LAST_RATE = 0.01
"""Learning rate of the last step, as a share of the highest."""
_KEPT = (("other", 8), ("drawn", 5))
"""Tensors of a checkpoint."""


@dataclass(frozen=True)
class FieldFrame:
    """The frame in which a base lies in [-1, 1]: world = centre + scale frame."""

    centre: _Floats
    scale: float

    @classmethod
    def around(cls, verts: _Floats) -> FieldFrame:
        """Return the frame of a bounding box; its diagonal has the length 2."""
        low, high = verts.min(0), verts.max(0)
        return cls((low + high) / 2, float(np.linalg.norm(high - low)) / 2)

    def enter(self, points: _Floats) -> _Floats:
        """Return world points in the frame."""
        return (points - self.centre) / self.scale

    def leave(self, points: _Floats) -> _Floats:
        """Return points of the frame in the world."""
        return self.centre + self.scale * points


@dataclass(frozen=True)
class FitOptions:
    """How to fit."""

    steps: int
    seed: int = 0
    # Of the network
    features: int = 8
    octaves: int = 6
    width: int = 32
    depth: int = 2


class _Places(NamedTuple):
    """Places of a few steps: the corners of a triangle of each face; then samples, places of borders, and anchors."""

    triangles: Tensor  # (F, 3, 3) float32: barycentric coordinates
    # Of the others, (P, 3)
    corners: Tensor
    weights: Tensor
    # Of all
    points: Tensor  # (3 F + P, 3) float32: of the base
    encoded: Tensor  # (3 F + P, 3 + 6 octaves) float32
    counts: list[int]


class FieldFit:
    """The optimisation of one field.

    Parameters
    ----------
    verts : (V, 3) float64
        The base's vertices in the frame, as the file will hold them.
    faces : (F, 3) int64
    initial : mapping of str to array, optional
        Tensors of a checkpoint of the same base and network; the fit starts with its field at step 0.
    anchors : ((A, 3), (A, 3)) float64, optional
        Points near the base, and the points near the surface where they go, both in the frame.

    Attributes
    ----------
    field : FieldNetwork
        Rounded if the fit is in its last part.
    rounding : list of int, optional
        The steps of rounding, from then on.

    Raises
    ------
    CheckpointError
        A checkpoint does not fit.
    """

    def __init__(
        self,
        surface: SourceSurface,
        frame: FieldFrame,
        verts: _Floats,
        faces: _Index,
        options: FitOptions,
        checkpoint: Checkpoint | None = None,
        initial: Mapping[str, NDArray[Any]] | None = None,
        anchors: tuple[_Floats, _Floats] | None = None,
    ) -> None:
        self._surface, self._frame, self._options = surface, frame, options
        self.verts, self.faces = verts, faces
        o = options
        self._learned = FieldNetwork.random(len(verts), o.features, o.octaves, o.width, o.depth, o.seed)
        self.field = self._learned
        self.rounding: list[int] | None = None
        self._random = torch.Generator().manual_seed(o.seed)
        self.step, self._folded = 0, 0
        weights, small = patch(_PARTS)
        self._small = torch.from_numpy(weights[small]).float()  # (64, 3, 3): the corners of a face's triangles
        self._base, self._corners = torch.from_numpy(verts).float(), torch.from_numpy(faces)
        corners = self._base[self._corners]
        area = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1)
        # Between equal shares of the faces and of the area: small faces are where the surface bends.
        root = area.clamp_min(1e-12).sqrt()
        self._shares = root / root.mean()
        self._level = level_of(faces, len(verts), 2)
        self._rim = border_places(verts, faces, glue(verts, faces), _OTHER_SAMPLES // 2)
        self._other: list[Tensor] = []
        self._drawn: list[Tensor] = []
        self._anchors = self._placed(*anchors) if anchors is not None and len(anchors[0]) else None
        features, *layers = self._learned.tensors
        self._optimizer = Adam([{"params": [features], "lr": 0.0}, {"params": layers, "lr": 0.0}])
        if checkpoint is not None:
            self._restore(checkpoint)
        elif initial is not None:
            self._take(tensors_of(initial))
        for tensor in self._learned.tensors:
            tensor.requires_grad_()
        self._round()
        if self._drawn:
            self._places = self._places_of_drawn()

    def __iter__(self) -> Iterator[dict[str, float]]:
        """Run the remaining steps; yield the losses of each by name, distances as shares of the diagonal.

        Raises
        ------
        NumericalError
            A loss is not finite.
        """
        while self.step < self._options.steps:
            yield self._advance()

    def _advance(self) -> dict[str, float]:
        anew = self.step in [int(share * self._options.steps) for share in _OTHER_AT] or not self._other
        if anew:
            self._find_other()
        if anew or self.step % _AGAIN == 0:
            self._draw()
        squared, normal = self._squares()
        loss = squared["distance"] + _NORMAL * normal + squared["back"] + squared.get("anchors", 0.0)
        loss = loss + _BORDER * squared.get("border", 0.0)
        if not bool(torch.isfinite(loss)):
            raise NumericalError("The fit diverged.", advice="Set another params.seed.")
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for group, times in zip(self._optimizer.param_groups, (_OF_FEATURES, 1.0), strict=True):
            group["lr"] = times * self._rate()
        self._optimizer.step()
        self.step += 1
        self._round()
        lengths = {name: math.sqrt(float(value.detach())) / 2 for name, value in squared.items()}
        return {"total": float(loss.detach()), "normals": float(normal.detach()), **lengths}

    def _round(self) -> None:
        """Round the field for the next step, if it is in the last part of the fit."""
        if self.rounding is None and self.step >= START * self._options.steps:
            self.rounding = steps_of(self._learned.tensors)
        if self.rounding is not None:
            self.field = self._learned.with_tensors(rounded(self._learned.tensors, self.rounding))

    def _rate(self) -> float:
        """Return the learning rate of the layers: a short rise, then half a cosine."""
        share = self.step / max(self._options.steps, 1)
        fall = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * share))
        return _RATE * min(1.0, (self.step + 1) / _WARM_STEPS) * fall

    @torch.no_grad()
    def _draw(self) -> None:
        """Draw the triangles, samples and places of borders of some steps, and project the triangles' middles."""
        which = torch.randint(0, len(self._small), (len(self.faces),), generator=self._random)
        samples = torch.randint(0, len(self._other[2]), (_OTHER_BATCH,), generator=self._random)
        borders = len(self._other[6])
        rim = torch.randint(0, max(borders, 1), (_BORDER_BATCH if borders else 0,), generator=self._random)
        self._drawn = [which, samples, rim]
        self._places = self._places_of_drawn()
        middles, normals = _triangles(self._moved()[0])
        self._drawn += self.project(middles, normals)

    def _places_of_drawn(self) -> _Places:
        which, samples, rim = self._drawn[:3]
        corners, weights = (
            [self._other[0][samples], self._other[4][rim]],
            [self._other[1][samples], self._other[5][rim]],
        )
        if self._anchors is not None:
            corners, weights = [*corners, self._anchors[0]], [*weights, self._anchors[1]]
        triangles, at, shares = self._small[which], torch.cat(corners), torch.cat(weights)
        inside = torch.bmm(triangles, self._base[self._corners]).reshape(-1, 3)
        points = torch.cat([inside, _mixed(self._base, at, shares)])
        counts = [len(inside), *map(len, corners)]
        return _Places(triangles, at, shares, points, octaves_of(points, self._options.octaves), counts)

    def _moved(self) -> list[Tensor]:
        """Return f at the places of this step: of triangles, samples, borders and anchors."""
        at, learned = self._places, self.field.features
        of_triangles = torch.bmm(at.triangles, learned[self._corners]).reshape(-1, learned.shape[1])
        features = torch.cat([of_triangles, _mixed(learned, at.corners, at.weights)])
        return list(torch.split(at.points + self.field.displacement(features, at.encoded), at.counts))

    def _squares(self) -> tuple[dict[str, Tensor], Tensor]:
        """Return the mean squared distances by name, and the error of normals."""
        triangles, moved, rim, *anchors = self._moved()
        _, samples, border, target, direction = self._drawn
        middles, normals = _triangles(triangles)
        apart = middles - target
        to = (apart * direction).sum(1).square()
        facing = (normals * direction).sum(1)
        turned = float((facing < 0).float().mean())
        settled = self.step >= _SETTLED * self._options.steps
        self._folded = self._folded + 1 if (turned > _FOLDED and settled) or self._folded >= _STEPS else 0
        more = _UNFOLD * min(max(turned / _LEFT - 1, 0), 1) if self._folded >= _STEPS else 0
        off = ((moved - self._other[2][samples]) * self._other[3][samples]).sum(1)
        squared = {
            "distance": (self._shares * (to + _ALONG * (apart.square().sum(1) - to))).mean(),
            "back": off.square().mean(),
        }
        if len(border):
            aside = rim - self._other[6][border]
            squared["border"] = (aside.square().sum(1) - (aside * self._other[7][border]).sum(1).square()).mean()
        if self._anchors is not None:
            squared["anchors"] = (anchors[0] - self._anchors[2]).square().sum(1).mean()
        return squared, (1 + more) * (self._shares * (1 - facing)).mean()

    @torch.no_grad()
    def _find_other(self) -> None:
        """Sample the surface, and find the places of the base whose images are nearest."""
        seed = int(torch.randint(0, 2**31 - 1, (1,), generator=self._random))
        reference = self._surface.reference
        samples, normals = surface_samples(reference.verts, reference.faces, _OTHER_SAMPLES, seed)
        samples, level = self._frame.enter(samples), self._level
        images = self.positions(level.corners, level.weights)
        others = [*places_of(self.faces, level, images, samples, normals), samples, normals, *self._border_pairs()]
        tensors = [torch.from_numpy(each) for each in others]
        self._other = [each.float() if each.is_floating_point() else each for each in tensors]

    def _border_pairs(self) -> tuple[_Index, _Floats, _Floats, _Floats]:
        """Return places of the base's borders, the nearest ones of the surface's, both ways, and their directions."""
        reference, (corners, weights) = self._surface.reference, self._rim
        ends, shares = border_places(reference.verts, reference.faces, reference.twin, _OTHER_SAMPLES // 2)
        if not len(corners) or not len(ends):
            return corners[:0], weights[:0], weights[:0], weights[:0]
        start, end = reference.verts[ends[:, 0]], reference.verts[ends[:, 1]]
        along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
        goals, images = (
            self._frame.enter(shares[:, :1] * start + shares[:, 1:2] * end),
            self.positions(corners, weights),
        )
        there, back = cKDTree(goals).query(images)[1], cKDTree(images).query(goals)[1]
        place, goal = np.append(np.arange(len(images)), back), np.append(there, np.arange(len(goals)))
        return corners[place], weights[place], goals[goal], along[goal]

    def _placed(self, points: _Floats, goals: _Floats) -> tuple[Tensor, Tensor, Tensor]:
        """Return the nearest places of the base, as corners and weights, and the nearest places of the surface."""
        face, weights = SurfaceTree.of(self.verts, self.faces).find(points, np.zeros_like(points))
        target, _ = self.project(torch.from_numpy(goals), torch.zeros(goals.shape))
        return torch.from_numpy(self.faces[face]), torch.from_numpy(weights).float(), target

    def at(self, corners: Tensor, weights: Tensor) -> Tensor:
        """Return f (P, 3) float32 at places with corners (P, 3) and barycentric coordinates (P, 3)."""
        return self.field(_mixed(self._base, corners, weights), _mixed(self.field.features, corners, weights))

    @torch.no_grad()
    def positions(self, corners: _Index, weights: _Floats) -> _Floats:
        """Return f (P, 3) float64 in the frame."""
        return self.at(torch.from_numpy(corners), torch.from_numpy(weights).float()).double().numpy()

    def project(self, points: Tensor, normals: Tensor) -> tuple[Tensor, Tensor]:
        """Project points (P, 3) of the frame with unit normals (P, 3) to the surface."""
        world = self._frame.leave(points.double().numpy())
        place, normal = self._surface.project(world, normals.double().numpy())
        return torch.from_numpy(self._frame.enter(place)).float(), torch.from_numpy(normal).float()

    def checkpoint(self) -> Checkpoint:
        """Return the state; call only between two steps."""
        tensors = {"random": self._random.get_state(), "folded": torch.tensor(self._folded)}
        if self.rounding is not None:
            tensors["rounding"] = torch.tensor(self.rounding)
        for i, tensor in enumerate(self._learned.tensors):
            tensors[f"field.{i}"] = tensor.detach()
            state = self._optimizer.state.get(tensor)
            if state:
                tensors |= {f"adam.{i}.{name}": value for name, value in state.items()}
        if self._other:
            tensors |= {f"other.{i}": value for i, value in enumerate(self._other)}
            tensors |= {f"drawn.{i}": value for i, value in enumerate(self._drawn)}
        return Checkpoint(self.step, arrays_of(tensors))

    def _restore(self, checkpoint: Checkpoint) -> None:
        tensors = tensors_of(checkpoint.tensors)
        self._take(tensors)
        try:
            self._random.set_state(tensors["random"])
            self._folded = int(tensors.get("folded", 0))
            for i, tensor in enumerate(self._learned.tensors):
                if f"adam.{i}.step" in tensors:
                    self._optimizer.state[tensor] = {
                        name: tensors[f"adam.{i}.{name}"].clone() for name in ("step", "exp_avg", "exp_avg_sq")
                    }
            if "rounding" in tensors:
                self.rounding = tensors["rounding"].tolist()
            if "other.0" in tensors:
                self._other, self._drawn = ([tensors[f"{of}.{i}"] for i in range(n)] for of, n in _KEPT)
        except (KeyError, RuntimeError) as error:
            raise CheckpointError("The checkpoint does not hold a field of this kind.") from error
        self.step = checkpoint.step

    def _take(self, tensors: dict[str, Tensor]) -> None:
        for i, tensor in enumerate(self._learned.tensors):
            value = tensors.get(f"field.{i}")
            if value is None or value.shape != tensor.shape:
                raise CheckpointError("The checkpoint has a field with another base or network.")
            tensor.copy_(value)


def _mixed(values: Tensor, corners: Tensor, weights: Tensor) -> Tensor:
    """Interpolate values (V, K) of the base's vertices at places with corners (P, 3) and weights (P, 3)."""
    return torch.bmm(weights[:, None], values[corners])[:, 0]


def _triangles(corners: Tensor) -> tuple[Tensor, Tensor]:
    """Return the middles and unit normals (F, 3) of triangles whose corners (3 F, 3) follow each other."""
    a, b, c = corners.reshape(-1, 3, 3).unbind(1)
    return (a + b + c) / 3, functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1, eps=1e-12)
