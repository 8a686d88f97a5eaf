"""Let parts of a surface grow that smooth maps cannot give it: ears, noses, horns, fins, tails.

What the surface lacks sprouts from a patch of its own (`sprouts`); what it has, but must grow much, starts as it is.
Then the displacement d of the vertices of these parts and of their carriers is fitted, in 8 rounds of

    sum w |B (v + d) - y|^2  +  k (D / e)^2 / (400 V) |L^2 d|^2  +  0.02 / V |d|^2

over pairs both ways of samples of like parts, B their shares of the corners, L the graph Laplacian with weights of
one over the edges' lengths, e the mean edge, D the diagonal, V the number of vertices; k falls from 3 to 0.5, and
pairs are no longer than 0.2, at last 0.04 of D. The displacement, not the place, is smooth, so that what the surface
shows stays. All other vertices stay where they are.

Sources: Botsch and Kobbelt 2004, An intuitive framework for real-time freeform modeling (the bilaplacian of the
displacement); Sorkine et al. 2004, Laplacian surface editing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from meshdeform.exemplar.sprouts import Ground, Limb, limb_of, sprouted
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.samples import Samples, hidden, spread

__all__ = ["grown"]

_ROUNDS = 8
_STIFFNESS, _LIMITS = (3.0, 0.5), (0.2, 0.04)
_HELD, _SCALE = 0.02, 1 / 400
_SAMPLES, _LIMB_SAMPLES = 3000, 6000
_NORMAL, _COSINE, _APART = 0.1, 0.1, 4.0
_CARRIER, _BACK = 0.3, 1.5
_EDGE = (0.2, 5.0)
"""Least and greatest weight of an edge."""
_TINY = 1e-12


def grown(
    verts: Floats,
    faces: Index,
    codes: Index,
    goal_verts: Floats,
    goal_faces: Index,
    goal_codes: Index,
    *,
    parents: Mapping[int, int],
    much: Collection[int] = (),
) -> Floats:
    """Return the vertices (V, 3) of a surface whose parts have grown as those of its goal.

    Parameters
    ----------
    verts, faces, codes : arrays (V, 3) float64, (F, 3) and (F,) int64
        The surface, fitted to the goal but for what is to grow, and the part of each face.
    goal_verts, goal_faces, goal_codes : arrays (W, 3) float64, (G, 3) and (G,) int64
        The goal, and the part of each face; like parts have equal numbers.
    parents : mapping of int to int
        Each part that only the goal has and that is to sprout, with the part of the surface on which it does.
    much : collection of int
        Parts of both that must grow much.
    """
    goal = _Goal(goal_verts, goal_faces, goal_codes)
    limbs = {code: limb for code in sorted(parents) if (limb := goal.limb(code)) is not None}
    start, codes = _sprout(verts, faces, codes, goal, limbs, parents)
    growing = set(much) | set(limbs)
    growing &= set(codes.tolist()) & set(goal_codes.tolist())
    if not growing:
        return verts.copy()
    carriers = {parents[code] for code in growing if code in parents} | _beside(faces, codes, growing, len(verts))
    return _Growth(verts, faces, codes, goal, growing, carriers).run(start)


class _Goal:
    """What is seen of the goal: samples with their parts."""

    def __init__(self, verts: Floats, faces: Index, codes: Index) -> None:
        samples = spread(verts, faces, _LIMB_SAMPLES, 4)
        self._all, self._codes = samples, codes[samples.faces]
        self._inside = hidden(samples, self._codes)
        self.samples, self.codes = samples.rows(~self._inside), self._codes[~self._inside]
        self.area = float(_areas(verts, faces).sum()) / _LIMB_SAMPLES
        """Of the surface that each sample stands for."""

    def limb(self, code: int) -> Limb | None:
        """Return what is seen of a part."""
        return limb_of(self._all, self._codes == code, self._inside, self.area)

    def seen(self, code: int) -> float:
        """Return the area that is seen of a part."""
        return float((self.codes == code).sum()) * self.area


def _areas(verts: Floats, faces: Index) -> Floats:
    a, b, c = verts[faces].transpose(1, 0, 2)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def _sprout(
    verts: Floats, faces: Index, codes: Index, goal: _Goal, limbs: Mapping[int, Limb], parents: Mapping[int, int]
) -> tuple[Floats, Index]:
    """Return where the vertices start, and the codes of the faces with those of the patches."""
    start, codes = verts.copy(), codes.copy()
    ground = Ground.of(verts, faces)
    carriers = {code: np.unique(faces[codes == parents[code]]) for code in limbs}
    for code, limb in limbs.items():
        siblings = [other for key, other in limbs.items() if parents[key] == parents[code]]
        whole = goal.seen(parents[code]) + sum(other.area for other in siblings)
        room = min((float(np.linalg.norm(limb.root - o.root)) for k, o in limbs.items() if k != code), default=np.inf)
        sprout = sprouted(limb, ground, carriers[code], limb.area / whole, room)
        if sprout is not None:
            start[sprout.verts] = sprout.start
            patch = np.zeros(len(verts), bool)
            patch[sprout.verts] = True
            codes[patch[faces].sum(1) >= 2] = code
    return start, codes


def _beside(faces: Index, codes: Index, growing: Collection[int], count: int) -> set[int]:
    """Return the parts that touch those that grow."""
    near = np.zeros(count, bool)
    near[faces[np.isin(codes, list(growing))]] = True
    return set(codes[near[faces].any(1)].tolist()) - set(growing)


class _Growth:
    """The vertices that may move, the smoothness of their displacement, and the samples of what they become."""

    def __init__(
        self,
        verts: Floats,
        faces: Index,
        codes: Index,
        goal: _Goal,
        growing: Collection[int],
        carriers: Collection[int],
    ) -> None:
        self._rest = verts
        moving = np.isin(codes, [*growing, *carriers])
        self._faces, self._codes = faces[moving], codes[moving]
        self._free = np.unique(self._faces)
        self._place = np.full(len(verts), -1)
        self._place[self._free] = np.arange(len(self._free))
        self._diagonal = float(np.linalg.norm(np.ptp(verts[np.unique(faces)], axis=0)))
        self._smooth = self._smoothness(verts, faces)
        kept = np.isin(goal.codes, [*growing, *carriers])
        self._goal: Samples = goal.samples.rows(kept)
        self._goal_codes = goal.codes[kept]
        part = np.where(np.isin(self._goal_codes, list(growing)), 1.0, _CARRIER)
        self._importance = part / max(len(goal.codes), 1)
        self._features = self._described(self._goal.places, self._goal.normals, self._goal_codes)
        self._tree = cKDTree(self._features)

    def _smoothness(self, verts: Floats, faces: Index) -> sparse.csc_matrix:
        """Return the matrix of the squared bilaplacian of the displacements of the free vertices."""
        count = len(verts)
        edges = np.unique(np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), 1), axis=0)
        lengths = np.linalg.norm(verts[edges[:, 0]] - verts[edges[:, 1]], axis=1)
        mean = max(float(lengths.mean()), _TINY)
        weights = np.clip(mean / np.maximum(lengths, _TINY), *_EDGE)
        graph = sparse.csr_matrix((weights, (edges[:, 0], edges[:, 1])), (count, count))
        graph = graph + graph.T
        degree = np.maximum(np.asarray(graph.sum(1)).ravel(), _TINY)
        laplacian = (sparse.identity(count) - sparse.diags(1 / degree) @ graph).tocsc()[:, self._free]
        scale = _SCALE * (self._diagonal / mean) ** 2 / count
        return (laplacian.T @ laplacian * scale).tocsc()

    def _described(self, places: Floats, normals: Floats, codes: Index) -> Floats:
        return np.hstack([places / self._diagonal, _NORMAL * normals, _APART * codes[:, None]])

    def run(self, start: Floats) -> Floats:
        """Return the vertices (V, 3) after all rounds."""
        now = start.copy()
        for number in range(_ROUNDS):
            share = number / (_ROUNDS - 1)
            stiffness = _STIFFNESS[0] * (_STIFFNESS[1] / _STIFFNESS[0]) ** share
            limit = _LIMITS[0] * (_LIMITS[1] / _LIMITS[0]) ** share * self._diagonal
            now[self._free] += self._step(now, stiffness, limit, number)
        return now

    def _step(self, now: Floats, stiffness: float, limit: float, seed: int) -> Floats:
        """Return what the free vertices move in a round, (C, 3)."""
        shares, apart, weights = self._pairs(now, limit, seed)
        moved = now[self._free] - self._rest[self._free]
        keep = stiffness * self._smooth + _HELD / len(self._rest) * sparse.identity(len(self._free))
        weighed = shares.T.multiply(weights).tocsr()
        factor = splu((weighed @ shares + keep).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        return np.asarray(factor.solve(np.asarray(weighed @ apart - keep @ moved)))

    def _pairs(self, now: Floats, limit: float, seed: int) -> tuple[sparse.csr_matrix, Floats, Floats]:
        """Pair samples both ways: shares (P, C) of the free vertices, differences (P, 3), weights (P,)."""
        own = spread(now, self._faces, _SAMPLES, seed)
        codes = self._codes[own.faces]
        described = self._described(own.places, own.normals, codes)
        there, back = self._tree.query(described)[1], cKDTree(described).query(self._features)[1]
        source = np.concatenate([np.arange(_SAMPLES), back])
        target = np.concatenate([there, np.arange(len(self._goal_codes))])
        apart = self._goal.places[target] - own.places[source]
        lengths = np.linalg.norm(apart, axis=1)
        alike: Flags = self._goal_codes[target] == codes[source]
        alike &= (self._goal.normals[target] * own.normals[source]).sum(1) > _COSINE
        weights = alike * (lengths < limit) / np.sqrt(1 + (2 * lengths / limit) ** 2) * self._importance[target]
        weights[:_SAMPLES] *= len(self._goal_codes) / _SAMPLES
        weights[_SAMPLES:] *= _BACK
        rows = np.repeat(np.arange(len(source)), 3)
        columns = self._place[self._faces[own.faces[source]]].ravel()
        shares = sparse.csr_matrix((own.shares[source].ravel(), (rows, columns)), (len(source), len(self._free)))
        return shares, apart, weights
