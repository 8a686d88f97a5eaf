"""Fit a member to an asset by one affine map for each group of its solids: articulated iterated closest points.

A point x of group g goes to A_g h, h = ((x - c_g) / r_g, 1). With samples paired by their features both ways, y and n
the asset's point and normal, each round solves the linear least squares

    sum w [ (n . (A_g h - y))^2 + 0.15 |A_g h - y|^2 ]       pairs, w = 1 / (1 + (2 |A_g h - y| / limit)^2)
    + l m_g |A_g - L_g|^2                                     near a similarity: L_g = half of A_g with stretches in
                                                              0.5 to 2, half of its closest similarity; m_g its mass
    + min(m_i, m_j) |A_i h_i(c) - A_j h_j(c)|^2               ties at points c where groups touch
    + 0.3 (1 - 0.8 s) min(m_i, m_j) |A_i - M A_j M|^2         mirror images alike, M = diag(-1, 1, 1)

while l falls from 0.6 to 0.05 and the limit from 0.25 to 0.06 of the diagonal. The residual of a fit is the mean of

    sqrt( (n . (x - y))^2 + max(t - 0.02, 0)^2 + (0.12 |n_x - n|)^2 ),   t = |x - y| in the plane of y,

over pairs both ways: not of |x - y|, which is mostly the distance between samples.

Sources: Besl and McKay 1992, A method for registration of 3-D shapes; Chen and Medioni 1992, Object modelling by
registration of multiple range images (planes); Amberg et al. 2007, Optimal step nonrigid ICP (falling stiffness).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.nouns.labels import Floats, LabelledMember
from meshdeform.reading.affine_systems import AffineSystem, mapped, mirror_matrix, tie_matrix, turned_normals
from meshdeform.reading.banks import candidate_member
from meshdeform.reading.choice import Candidate, FrontFrame, box_scale, placed
from meshdeform.reading.groups import Groups, groups_of
from meshdeform.reading.samples import NORMAL_WEIGHT, Samples, features, hidden, spread

__all__ = ["AssetSamples", "MemberFit", "fit_candidate"]

_ROUNDS, _ROUGH_ROUNDS, _ROUGH = 24, 12, 500
"""Rounds with a third of the samples come first."""
_SAMPLES = 1500
_LIMITS, _STIFFNESS = (0.25, 0.06), (0.6, 0.05)
_POINTWISE = 0.15
_STRETCH = (0.5, 2.0)
_MIRROR = 0.3
_LEAST_MASS = 0.035
_SPACING = 0.02


@dataclass(frozen=True)
class MemberFit:
    """A member fitted to an asset.

    `member` lies on the asset; `residual` is the mean distance between the surfaces, `strain` the mean logarithm of
    the maps' stretches; `score`, the residual made worse by strain, orders fits.
    """

    candidate: Candidate
    member: LabelledMember
    residual: float
    strain: float

    @property
    def score(self) -> float:
        """The residual, made worse by strain."""
        return self.residual * (1 + 0.3 * self.strain)


class AssetSamples:
    """Samples of the asset, and few of them for the first rounds, with trees of their features."""

    def __init__(self, frame: FrontFrame) -> None:
        mixed = np.random.default_rng(7).permutation(_SAMPLES)
        self.all = spread(frame.verts, frame.faces, _SAMPLES, 3).rows(mixed)
        self.features = features(self.all.positions, self.all.normals)
        self.tree, self.rough_tree = cKDTree(self.features), cKDTree(self.features[:_ROUGH])

    def of_round(self, rough: bool) -> tuple[Floats, Floats, Floats, cKDTree]:
        """Return points, normals, features and their tree."""
        count = _ROUGH if rough else _SAMPLES
        tree = self.rough_tree if rough else self.tree
        return self.all.positions[:count], self.all.normals[:count], self.features[:count], tree


def fit_candidate(asset: AssetSamples, frame: FrontFrame, candidate: Candidate) -> MemberFit:
    """Draw a candidate's member, scale it to the asset's box and fit it."""
    member = candidate_member(candidate.noun, candidate.number)
    low, high = member.verts.min(0), member.verts.max(0)
    scale, _ = box_scale(low, high, frame)
    member = member.moved(placed(member.verts, low, high, scale, frame))
    samples = spread(member.verts, member.faces, _SAMPLES, 0)
    shown = samples.rows(np.random.default_rng(8).permutation(_SAMPLES))
    shown = shown.rows(~hidden(shown, member.solid_of_face[shown.faces]))
    system = _Articulated(groups_of(member), member, shown)
    for number in range(_ROUNDS):
        system.step(asset, number / (_ROUNDS - 1), rough=number < _ROUGH_ROUNDS)
    return MemberFit(candidate, member.moved(system.mapped(member.verts)), system.residual(asset), system.strain())


def _surface_distance(x: Floats, normals: Floats, y: Floats, other_normals: Floats) -> Floats:
    """Return the distance (N,) of points to the planes of the points y, which are samples some way apart."""
    apart = x - y
    across = (apart * other_normals).sum(1)
    along = np.sqrt(np.maximum(np.square(apart).sum(1) - across**2, 0))
    turned = NORMAL_WEIGHT * np.linalg.norm(normals - other_normals, axis=1)
    return np.asarray(np.sqrt(across**2 + np.maximum(along - _SPACING, 0) ** 2 + turned**2))


class _Articulated:
    """The maps (G, 3, 4) of the groups of a member, and the system that moves them."""

    def __init__(self, groups: Groups, member: LabelledMember, samples: Samples) -> None:
        self.groups, count = groups, len(groups)
        order = np.arange(len(samples.positions))
        self.group_of = groups.of_vert[member.faces[samples.faces, 0]][order]
        self.h = groups.homogeneous(samples.positions, self.group_of)
        self.rest_normals = samples.normals
        self.maps = np.zeros((count, 3, 4))
        self.maps[:, :, :3] = np.eye(3) * groups.radii[:, None, None]
        self.maps[:, :, 3] = groups.centres
        self.mass = np.bincount(self.group_of, minlength=count) / max(len(self.group_of), 1)
        self.ties, self.mirror = self._ties(), mirror_matrix(count, groups.mirrored, self.mass)
        self.first = True
        self._move()

    def _move(self) -> None:
        self.positions = mapped(self.maps, self.group_of, self.h)
        self.normals = turned_normals(self.maps, self.group_of, self.rest_normals)

    def mapped(self, verts: Floats) -> Floats:
        """Return the vertices of the member where the maps take them."""
        groups = self.groups.of_vert
        return mapped(self.maps, groups, self.groups.homogeneous(verts, groups))

    def residual(self, asset: AssetSamples) -> float:
        """Return the mean distance of samples to the other surface, both ways, by the equation at the head."""
        own = features(self.positions, self.normals)
        nearest, back = asset.tree.query(own)[1], cKDTree(own).query(asset.features)[1]
        there = _surface_distance(
            self.positions, self.normals, asset.all.positions[nearest], asset.all.normals[nearest]
        )
        here = _surface_distance(asset.all.positions, asset.all.normals, self.positions[back], self.normals[back])
        return float(there.mean() + here.mean()) / 2

    def strain(self) -> float:
        """Return the mean absolute logarithm of the maps' stretches."""
        stretches = np.linalg.svd(self.maps[:, :, :3] / self.groups.radii[:, None, None], compute_uv=False)
        return float(np.abs(np.log(np.clip(stretches, 0.1, 10))).mean())

    def step(self, asset: AssetSamples, share: float, *, rough: bool) -> None:
        """Move the maps by one round; `share` goes from 0 to 1 over all rounds."""
        system = AffineSystem(len(self.groups))
        limit = _LIMITS[0] * (_LIMITS[1] / _LIMITS[0]) ** share
        self._add_pairs(system, asset, limit, rough)
        self._add_stiffness(system, _STIFFNESS[0] * (_STIFFNESS[1] / _STIFFNESS[0]) ** share)
        system.matrix += self.ties + _MIRROR * (1 - 0.8 * share) * self.mirror
        self.maps = system.solve(1e-7)
        self.first = False
        self._move()

    def _add_pairs(self, system: AffineSystem, asset: AssetSamples, limit: float, rough: bool) -> None:
        y, n, asset_features, tree = asset.of_round(rough)
        few = slice(None, _ROUGH) if rough else slice(None)
        positions, normals, own, h = self.positions[few], self.normals[few], self.group_of[few], self.h[few]
        mine = features(positions, normals)
        to_asset, to_member = tree.query(mine)[1], cKDTree(mine).query(asset_features)[1]
        source = np.concatenate([np.arange(len(mine)), to_member])
        target, normal = np.concatenate([y[to_asset], y]), np.concatenate([n[to_asset], n])
        distance = np.linalg.norm(target - positions[source], axis=1)
        near = ((normal * normals[source]).sum(1) > 0.1) & (distance < 1.5 * limit)
        weight = near / (1 + (2 * distance / limit) ** 2)
        weight[: len(mine)] /= len(mine)
        weight[len(mine) :] /= len(y)
        used = np.flatnonzero(weight)
        used = used[np.argsort(own[source[used]], kind="stable")]
        paired = source[used]
        system.add_pairs(own[paired], h[paired], target[used], normal[used], weight[used], _POINTWISE)

    def _add_stiffness(self, system: AffineSystem, stiffness: float) -> None:
        radii = self.groups.radii[:, None, None]
        u, stretches, v = np.linalg.svd(self.maps[:, :, :3] / radii)
        stretches[np.linalg.det(u @ v) < 0, 2] *= -1
        kept = (u * np.clip(stretches, *_STRETCH)[:, None]) @ v
        wanted = 0.5 * kept + 0.5 * (u @ v) * np.abs(stretches).mean(1)[:, None, None]
        wanted = np.broadcast_to(np.eye(3), wanted.shape) if self.first else wanted
        weights = np.full((len(self.groups), 3, 4), 1e-4)
        weights[:, :, :3] = stiffness * np.maximum(self.mass, _LEAST_MASS)[:, None, None]
        goals = np.concatenate([wanted * radii, self.maps[:, :, 3:]], 2)
        system.add_goals(weights, goals)

    def _ties(self) -> Floats:
        """Return the matrix of the ties, which is the same in every round."""
        groups = self.groups
        ties = []
        for i, j, position in groups.ties:
            one, other = groups.homogeneous(np.stack([position, position]), np.array([i, j]))
            ties.append((i, j, one, other, min(self.mass[i], self.mass[j]) + 0.02))
        return tie_matrix(len(groups), ties)
