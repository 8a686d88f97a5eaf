"""Fit a field to a surface.

Each step takes faces of the base at random, divides each into 64 triangles, and moves f there towards its own
projection q, which is constant within the step:

    L = mean |f(p) - q(f(p))|^2 + w_n mean (1 - n(f) . n_q) + mean (n_s . (f(p_s) - s))^2

Where both have borders, pairs of their nearest places, both ways, add their distances across the surface's border. With
anchors, also the mean |f(p_a) - s_a|^2 of places p_a of the base that belong to places s_a of the surface.

The last term is the other direction: samples s of the surface with normals n_s, and the place p_s of the base whose
image is nearest, found again every 100 steps. Without it f could leave out parts of the surface.

In the last part of a fit the tensors are rounded as the file will hold them (`network.rounded`).

Source: Noma et al. 2026, section 4; weights and schedule are measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from meshdeform.deformation.checkpoint import Checkpoint
from meshdeform.deformation.variables import Adam
from meshdeform.errors import CheckpointError, NumericalError
from meshdeform.geometry.places import SurfaceTree, surface_samples
from meshdeform.kinds.surface_fit.base_places import border_places, places_of
from meshdeform.kinds.surface_fit.gluing import glue
from meshdeform.kinds.surface_fit.network import START, FieldNetwork, octaves_of, rounded, steps_of
from meshdeform.kinds.surface_fit.patches import level_of, patch
from meshdeform.kinds.surface_fit.surface_sources import Surface

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_PARTS = 8
_OTHER_EVERY = 100
_OTHER_SAMPLES = 8192
_OTHER_BATCH = 1024
_BORDER_BATCH = 512
_WARM_STEPS = 20
_BORDER = 0.3
"""Weight of the distance between borders, beside that of the surfaces."""
_FOLDED, _STEPS, _LEFT, _UNFOLD = 0.02, 10, 0.005, 300
"""A fit is folded with such a share of triangles reversed in so many steps after each other; the share that may stay,
and how much more normals count at twice that. A base of another shape unfolds only so; others are fitted less well."""
_LAST_RATE = 0.01
"""Learning rate of the last step, as a share of the highest."""


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
    batch_faces: int = 96  # base faces per step
    learning_rate: float = 0.01
    normal_weight: float = 1e-4


class FieldFit:
    """The optimisation of one field.

    Parameters
    ----------
    verts : (V, 3) float64
        The base's vertices in the frame, as the file will hold them.
    faces : (F, 3) int64
    initial : dict of str to Tensor, optional
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
        surface: Surface,
        frame: FieldFrame,
        verts: _Floats,
        faces: _Index,
        options: FitOptions,
        checkpoint: Checkpoint | None = None,
        initial: dict[str, Tensor] | None = None,
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
        self._weights, self._small = torch.from_numpy(weights).float(), torch.from_numpy(small)
        corners = torch.from_numpy(verts[faces]).float()
        self._corners = torch.from_numpy(faces)
        self._points = torch.einsum("pk,fkc->fpc", self._weights, corners)
        self._octaves = octaves_of(self._points, o.octaves)
        area = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1)
        # Between equal shares of the faces and of the area: small faces are where the surface bends.
        self._chance = (area.clamp_min(1e-12)).sqrt()
        self._level = level_of(faces, len(verts), 2)
        self._rim = border_places(verts, faces, glue(verts, faces), _OTHER_SAMPLES // 2)
        self._other: list[Tensor] = []
        self._anchors = self._placed(*anchors) if anchors is not None and len(anchors[0]) else None
        self._optimizer = Adam([{"params": self._learned.tensors, "lr": 0.0}])
        if checkpoint is not None:
            self._restore(checkpoint)
        elif initial is not None:
            self._take(initial)
        for tensor in self._learned.tensors:
            tensor.requires_grad_()
        self._round()

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
        if self.step % _OTHER_EVERY == 0 or not self._other:
            self._find_other()
        chosen = torch.multinomial(
            self._chance, min(self._options.batch_faces, len(self.faces)), generator=self._random
        )
        there, normal = self._towards(chosen)
        back = self._backwards()
        loss = there + self._options.normal_weight * normal + back
        losses = {}
        if self._anchors is not None:
            corners, weights, goals = self._anchors
            held = (self.at(corners, weights) - goals).square().sum(1).mean()
            loss = loss + held
            losses = {"anchors": math.sqrt(float(held.detach())) / 2}
        corners, weights, goals, along = self._other[4:]
        if len(goals):
            rows = torch.randint(0, len(goals), (_BORDER_BATCH,), generator=self._random)
            apart = self.at(corners[rows], weights[rows]) - goals[rows]
            border = (apart.square().sum(1) - (apart * along[rows]).sum(1).square()).mean()
            loss = loss + _BORDER * border
            losses["border"] = math.sqrt(float(border.detach())) / 2
        if not bool(torch.isfinite(loss)):
            raise NumericalError("The fit diverged.", advice="Set params.learning_rate lower.")
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._optimizer.param_groups[0]["lr"] = self._rate()
        self._optimizer.step()
        self.step += 1
        self._round()
        losses |= {
            "distance": math.sqrt(float(there.detach())) / 2,
            "normals": float(normal.detach()),
            "back": math.sqrt(float(back.detach())) / 2,
        }
        return {"total": float(loss.detach()), **losses}

    def _round(self) -> None:
        """Round the field for the next step, if it is in the last part of the fit."""
        if self.rounding is None and self.step >= START * self._options.steps:
            self.rounding = steps_of(self._learned.tensors, self._options.steps)
        if self.rounding is not None:
            self.field = self._learned.with_tensors(rounded(self._learned.tensors, self.rounding))

    def _rate(self) -> float:
        """Return the learning rate: a short rise, then half a cosine."""
        share = self.step / max(self._options.steps, 1)
        fall = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + math.cos(math.pi * share))
        return self._options.learning_rate * min(1.0, (self.step + 1) / _WARM_STEPS) * fall

    def _towards(self, chosen: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean squared distance from the field to its projection, and the error of normals."""
        features = torch.einsum("pk,fkd->fpd", self._weights, self.field.features[self._corners[chosen]])
        count = chosen.shape[0] * self._weights.shape[0]
        encoded = self._octaves[chosen].reshape(count, -1)
        moved = self._points[chosen].reshape(count, 3) + self.field.displacement(features.reshape(count, -1), encoded)
        placed = moved.reshape(chosen.shape[0], -1, 3)
        a, b, c = placed[:, self._small].unbind(2)
        cross = torch.linalg.cross(b - a, c - a)
        normals = functional.normalize(cross, dim=-1, eps=1e-12)
        with torch.no_grad():
            hints = torch.zeros_like(placed)
            for k in range(3):
                hints.index_add_(1, self._small[:, k], normals)
            hints = functional.normalize(hints, dim=-1).reshape(count, 3)
        target, directions = self.project(moved.detach(), hints)
        mean = functional.normalize(directions.reshape(chosen.shape[0], -1, 3)[:, self._small].sum(2), dim=-1)
        facing = (normals * mean).sum(-1)
        turned = float((facing < 0).float().mean())
        self._folded = self._folded + 1 if turned > _FOLDED or self._folded >= _STEPS else 0
        more = _UNFOLD * min(max(turned / _LEFT - 1, 0), 1) if self._folded >= _STEPS else 0
        return (moved - target).square().sum(1).mean(), (1 + more) * (1 - facing).mean()

    def _backwards(self) -> Tensor:
        """Return the mean squared distance of samples of the surface from the field, along their normals."""
        corners, weights, samples, normals = self._other[:4]
        rows = torch.randint(0, len(samples), (_OTHER_BATCH,), generator=self._random)
        moved = self.at(corners[rows], weights[rows])
        return ((moved - samples[rows]) * normals[rows]).sum(1).square().mean()

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
        base = torch.from_numpy(self.verts).float()[corners]
        points = (weights[:, :, None] * base).sum(1)
        return self.field(points, (weights[:, :, None] * self.field.features[corners]).sum(1))

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
        return Checkpoint(self.step, {name: value.clone() for name, value in tensors.items()})

    def _restore(self, checkpoint: Checkpoint) -> None:
        tensors = checkpoint.tensors
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
            self._other = [tensors[f"other.{i}"] for i in range(8 if "other.0" in tensors else 0)]
        except (KeyError, RuntimeError) as error:
            raise CheckpointError("The checkpoint does not hold a field of this kind.") from error
        self.step = checkpoint.step

    def _take(self, tensors: dict[str, Tensor]) -> None:
        for i, tensor in enumerate(self._learned.tensors):
            value = tensors.get(f"field.{i}")
            if value is None or value.shape != tensor.shape:
                raise CheckpointError("The checkpoint has a field with another base or network.")
            tensor.copy_(value)
