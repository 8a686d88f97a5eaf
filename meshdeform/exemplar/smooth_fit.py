"""Fit a surface to another one by a smooth map, like parts to like parts: reweighted least squares over pairs.

The map is x' = x + sum over levels of u_l(x), displacements of quadratic B-splines (`splines`) over 3, 6 and 12
intervals of the longest side of the box, in turn, each level starting from the sum of the former ones. D is the
diagonal of the source's box, q goes from 0 to 1 over all rounds, what has two values goes from one to the other as
a (b / a)^q. A round:

1. 1200 samples of the source, with the normals that the cofactors of the nearest of 400 Jacobians give, and 1200 of
   the goal are paired both ways by (point / D, 0.1 normal, code). A pair of one code counts if its normals have a
   product above 0.1 and its length r is below d; its weight is 1 / sqrt(1 + (2 r / d)^2), twice that on the way back.
   Pairs back to one sample of the source are merged into their mean.
2. Minimise, over the level's numbers,

       mean w [0.9 (n . (x' - y))^2 + 0.1 |x' - y|^2]       n of the goal; on the way back, of the source
       + b D^4 bending(u_l)                                 b: 1e-4, 1e-7; of what is built: 1e-3, 1e-5
       + k D^2 mean s |J - P(J)|^2                          k: 1e-3, 1e-4; P(J): stretches in 0.25 to 4
       + 0.3 D^2 mean a (J_yx^2 + J_yz^2 + J_xy^2 + J_zy^2) of what is built: a = 1 where a face is level or upright,
                                                            0.2 elsewhere, so that both stay so
       + 0.05 mean |x'(p) - goal|^2                         landmarks
       + rows of other pulls, such as outlines

   up to 320 numbers by Cholesky's method, more by 20 steps of conjugate gradients in single precision.
3. Nothing folds: where the full step would make det J < 0.08 or a stretch < 0.125, s grows 8-fold, elsewhere it falls
   by 0.7 to 1, and the step is shortened until no det J is below the less of 0.08 and half of what it was.

With planes of symmetry the goal is moved so that its middle lies on them, and the map commutes with the reflections.

Sources: Chen and Medioni 1992, Object modelling by registration of multiple range images (planes); Rueckert et al.
1999, Nonrigid registration using free-form deformations; Amberg et al. 2007, Optimal step nonrigid ICP (falling
stiffness); Huber 1964, Robust estimation of a location parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from meshdeform.exemplar.conjugate_gradients import conjugate_gradients
from meshdeform.exemplar.splines import SplineGrid, Terms
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.samples import spread
from meshdeform.support.giving_way import give_way

__all__ = ["LEVELS", "LIMITS", "CodedSurface", "Pull", "PullRows", "pulls_to", "smooth_fit"]

LEVELS = ((3, 6), (6, 6), (12, 5))
"""Intervals along the longest side and rounds of each level."""
LIMITS = (0.5, 0.2)
"""Greatest length of a pair in the first and in the last round, a share of the diagonal."""

_SAMPLES, _JACOBIANS = 1200, 400
_SEED = 0
"""Of the samples of both surfaces, so that equal ones have equal samples and nothing moves."""
_NORMAL, _COSINE = 0.1, 0.1
_APART = 4.0
"""Distance between codes among the features: more than any points have."""
_POINTWISE, _BACK = 0.1, 2.0
_BENDING = {False: (1e-4, 1e-7), True: (1e-3, 1e-5)}
_STIFFNESS = (1e-3, 1e-4)
_LEVEL, _LEANING = 0.3, 0.2
_UPRIGHT, _FLAT = 0.05, 0.95
_STRETCH = (0.25, 4.0)
_LEAST_DET, _LEAST_STRETCH = 0.08, 0.125
_STIFFER, _SOFTER, _STIFFEST = 8.0, 0.7, 1e4
_SHORTER, _SHORTEST = 0.6, 0.02
_LANDMARKS = 0.05
_MARGIN = 0.02
_DENSE, _STEPS, _ENOUGH = 320, 20, 1e-6
_TINY = 1e-30


class PullRows(NamedTuple):
    """Rows of the least squares besides pairs: weights (R,) times (direction . (x'(point) - goal))^2.

    `positions` (R, 3) of the source at rest, unit `directions` (R, 3), and `apart` (R,), direction . (goal - x'(point))
    as the map is now.
    """

    positions: Floats
    directions: Floats
    apart: Floats
    weights: Floats


class Pull(Protocol):
    """What pulls at a surface besides the pairs, such as an outline."""

    def rows(self, moved: Callable[[Floats], Floats], share: float) -> PullRows:
        """Return the rows of a round; `moved` maps points (P, 3), `share` goes from 0 to 1 over all rounds."""
        ...


class CodedSurface(NamedTuple):
    """Vertices (V, 3) float64, faces (F, 3) int64, and a number for each face, (F,) int64: of its part, or its kind."""

    verts: Floats
    faces: Index
    codes: Index

    @classmethod
    def alike(cls, verts: Floats, faces: Index) -> CodedSurface:
        """Return a surface whose faces are all of one kind."""
        return cls(verts, faces, np.zeros(len(faces), np.int64))

    @classmethod
    def empty(cls) -> CodedSurface:
        """Return a surface without faces."""
        return cls.alike(np.zeros((0, 3)), np.zeros((0, 3), np.int64))


def smooth_fit(
    surface: CodedSurface,
    goal: CodedSurface,
    *,
    planes: Collection[int] = (0,),
    built: bool = False,
    levels: Sequence[tuple[int, int]] = LEVELS,
    limits: tuple[float, float] = LIMITS,
    reach: Floats | None = None,
    pulls: Sequence[Pull] = (),
) -> Floats:
    """Return the vertices (V, 3) of a surface fitted to another one.

    Parameters
    ----------
    surface, goal : CodedSurface
        In one frame; only faces of equal numbers are paired.
    planes : collection of int
        Axes across whose middle the map is symmetric.
    built : bool
        Level and upright faces stay so.
    levels : sequence of (int, int)
        Intervals along the longest side, and rounds.
    limits : (float, float)
        Greatest length of a pair, first and last, a share of the diagonal.
    reach : array (G,) float64, optional
        What the limits are multiplied by for each face of the goal.
    pulls : sequence of Pull
        What pulls besides.
    """
    if not len(surface.faces) or (not len(goal.faces) and not pulls):
        return surface.verts.copy()
    fit = _Fit(surface, _Goal(goal, reach), frozenset(planes), built)
    fit.run(levels, limits, pulls)
    return fit.moved(surface.verts)


def pulls_to(landmarks: tuple[Floats, Floats] | None) -> list[Pull]:
    """Return what pulls points (L, 3) of a surface to their goals (L, 3), if there are any."""
    return [] if landmarks is None or not len(landmarks[0]) else [_Landmarks(*landmarks)]


class _Goal:
    """Samples of the goal with their normals, codes and factors of the limit."""

    def __init__(self, surface: CodedSurface, reach: Floats | None) -> None:
        verts, faces, codes = surface
        if not len(faces):
            self.positions, self.normals = np.zeros((0, 3)), np.zeros((0, 3))
            self.codes, self.reach, self.middle = np.zeros(0, np.int64), np.zeros(0), np.zeros(3)
            return
        samples = spread(verts, faces, _SAMPLES, _SEED)
        self.positions, self.normals = samples.positions, samples.normals
        self.codes = codes[samples.faces]
        self.reach = np.ones(_SAMPLES) if reach is None else reach[samples.faces]
        used = verts[np.unique(faces)]
        self.middle = (used.min(0) + used.max(0)) / 2

    def centre(self, middle: Floats, planes: Collection[int]) -> None:
        """Move the samples along some axes so that the middle of the goal lies at that of the source."""
        if len(self.positions):
            for axis in planes:
                self.positions[:, axis] += middle[axis] - self.middle[axis]


class _Landmarks:
    """Places of the source and their goals, as pulls along the axes."""

    def __init__(self, positions: Floats, goals: Floats) -> None:
        self._positions, self._goals = np.asarray(positions, np.float64), np.asarray(goals, np.float64)

    def rows(self, moved: Callable[[Floats], Floats], _share: float) -> PullRows:
        """Return three rows for each landmark."""
        apart = self._goals - moved(self._positions)
        count = len(apart)
        directions = np.repeat(np.eye(3), count, 0)
        return PullRows(
            np.tile(self._positions, (3, 1)), directions, apart.T.ravel(), np.full(3 * count, _LANDMARKS / count)
        )


class _Level:
    """What a level knows of the samples of the source: the splines there, their derivatives, the bending."""

    def __init__(self, grid: SplineGrid, positions: Floats, chosen: Index, diagonal: float) -> None:
        self.grid = grid
        self.terms = grid.terms(positions)
        self.columns = np.concatenate([each.columns for each in self.terms], 1)
        self.matrices = [grid.matrix(each) for each in self.terms]
        self.slopes = grid.gradients(positions[chosen])
        self.gradient = grid.matrix(self.slopes)
        self.bending = grid.bending() * diagonal**4

    def rows_along(self, rows: Index, directions: Floats) -> Terms:
        """Return what takes the numbers to the displacements of some samples along directions (R, 3)."""
        values = [terms.values[rows] * directions[:, [axis]] for axis, terms in enumerate(self.terms)]
        return Terms(self.columns[rows], np.concatenate(values, 1))

    def pulled(self, pulls: PullRows) -> Terms:
        """Return what takes the numbers to the displacements of other points along their directions."""
        found = self.grid.terms(pulls.positions)
        values = [terms.values * pulls.directions[:, [axis]] for axis, terms in enumerate(found)]
        return Terms(np.concatenate([each.columns for each in found], 1), np.concatenate(values, 1))

    def change(self, numbers: Floats) -> Floats:
        """Return the changes (J, 3, 3) of the Jacobians by numbers (K,)."""
        return np.asarray((self.gradient @ numbers).reshape(3, 3, -1).transpose(2, 0, 1))


class _System:
    """Rows of a weighted least squares problem, |sqrt(w) (A x - b)|^2, and the right side of its normal equations."""

    def __init__(self, level: _Level) -> None:
        self._level = level
        self._blocks: list[sparse.csr_matrix] = []
        self.right = np.zeros(level.grid.count)

    def add(self, terms: Terms, weights: Floats, goals: Floats) -> None:
        """Add rows with weights and goals (R,)."""
        root = np.sqrt(weights)
        matrix = self._level.grid.matrix(Terms(terms.columns, terms.values * root[:, None]))
        self.right += matrix.T @ (root * goals)
        self._blocks.append(matrix)

    def solve(self, bending: float) -> Floats:
        """Return the numbers (K,) that minimise the sum with a weight of the bending."""
        if self._level.grid.count <= _DENSE:
            return self._dense(bending)
        return self._conjugate(bending)

    def _dense(self, bending: float) -> Floats:
        rows = [block.toarray() for block in self._blocks]
        matrix = sum((each.T @ each for each in rows), bending * self._level.bending.toarray())
        matrix[np.diag_indices(len(matrix))] += 1e-9 * np.trace(matrix) / len(matrix)
        factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
        return np.asarray(cho_solve(factor, self.right, check_finite=False))

    def _conjugate(self, bending: float) -> Floats:
        """Take a few steps of conjugate gradients, scaled by the diagonal: the next round corrects the rest."""
        rows = sparse.vstack(self._blocks, format="csr", dtype=np.float32)
        across = rows.T
        bend = (self._level.bending * bending).astype(np.float32)
        diagonal = np.bincount(rows.indices, rows.data.astype(np.float64) ** 2, rows.shape[1]) + bend.diagonal()
        diagonal = np.maximum(diagonal, 1e-6 * diagonal.max()).astype(np.float32)
        floor = np.float32(1e-8 * diagonal.max())
        right = self.right.astype(np.float32)
        numbers = conjugate_gradients(
            lambda direction: across @ (rows @ direction) + bend @ direction + floor * direction,
            diagonal,
            right,
            steps=_STEPS,
            enough=_ENOUGH,
        )
        return numbers.astype(np.float64)


class _Paired(NamedTuple):
    """Pulls of samples of the source to the goal.

    `samples`, `normals`, `apart`, `weights`: to planes. `pull` (N, 3) and `weight` (N,): the weighted sum of all
    differences of a sample, and of their weights.
    """

    samples: Index
    normals: Floats
    apart: Floats
    weights: Floats
    pull: Floats
    weight: Floats


class _Fit:
    """A surface on its way to a goal: its samples, and the levels gone so far."""

    def __init__(self, surface: CodedSurface, goal: _Goal, planes: frozenset[int], built: bool) -> None:
        verts, faces, codes = surface
        used = verts[np.unique(faces)]
        low, high = used.min(0), used.max(0)
        margin = _MARGIN * float((high - low).max())
        self._low, self._high, self._planes, self._built = low - margin, high + margin, planes, built
        self._diagonal = max(float(np.linalg.norm(high - low)), _TINY)
        samples = spread(verts, faces, _SAMPLES, _SEED)
        self._rest, self._rest_normals = samples.positions, samples.normals
        self._codes = codes[samples.faces]
        self._chosen = np.random.default_rng(5).permutation(_SAMPLES)[:_JACOBIANS]
        rest = np.hstack([self._rest / self._diagonal, _NORMAL * self._rest_normals])
        self._owner = cKDTree(rest[self._chosen]).query(rest)[1]
        goal.centre((low + high) / 2, planes)
        self._goal = goal
        self._goal_features = self._features(goal.positions, goal.normals, goal.codes)
        self._goal_tree = cKDTree(self._goal_features)
        self._positions, self._start = self._rest, self._rest
        self._jacobians = self._start_jacobians = np.tile(np.eye(3), (_JACOBIANS, 1, 1))
        self._stiffer = np.ones(_JACOBIANS)
        self._passed: list[tuple[SplineGrid, Floats]] = []

    def _features(self, positions: Floats, normals: Floats, codes: Index) -> Floats:
        return np.hstack([positions / self._diagonal, _NORMAL * normals, _APART * codes[:, None]])

    def moved(self, positions: Floats) -> Floats:
        """Return where the levels take points (P, 3) of the surface at rest."""
        moved = np.array(positions, np.float64)
        for grid, numbers in self._passed:
            moved += grid.displacements(positions, numbers)
        return moved

    def run(self, levels: Sequence[tuple[int, int]], limits: tuple[float, float], pulls: Sequence[Pull]) -> None:
        """Go through all rounds."""
        total, number = sum(rounds for _, rounds in levels), 0
        for spans, rounds in levels:
            grid = SplineGrid(self._low, self._high, spans, self._planes)
            level = _Level(grid, self._rest, self._chosen, self._diagonal)
            numbers = np.zeros(grid.count)
            self._start, self._start_jacobians = self._positions, self._jacobians
            self._passed.append((grid, numbers))
            for _ in range(rounds):
                give_way()
                share = number / max(total - 1, 1)
                number += 1
                step = self._step(level, numbers, share, limits, pulls)
                numbers = numbers + self._unfolded(level, step) * step
                self._passed[-1] = (grid, numbers)
                self._positions = self._start + np.stack([matrix @ numbers for matrix in level.matrices], 1)
                self._jacobians = self._start_jacobians + level.change(numbers)

    def _step(
        self, level: _Level, numbers: Floats, share: float, limits: tuple[float, float], pulls: Sequence[Pull]
    ) -> Floats:
        """Return the full step (K,) of a round."""
        system = _System(level)
        if len(self._goal.positions):
            self._add_pairs(system, level, in_ratio(limits, share) * self._diagonal)
        self._add_jacobians(system, level, share)
        for pull in pulls:
            rows = pull.rows(self.moved, share)
            if len(rows.positions):
                system.add(level.pulled(rows), rows.weights, rows.apart)
        bending = in_ratio(_BENDING[self._built], share)
        system.right -= bending * (level.bending @ numbers)
        return system.solve(bending)

    def _normals(self) -> Floats:
        """Return the normals (N, 3) of the samples as the nearest Jacobians turn them."""
        a, b, c = self._jacobians.transpose(1, 0, 2)
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
        normals = np.einsum("nij,nj->ni", cofactors[self._owner], self._rest_normals)
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))

    def _paired(self, limit: float) -> _Paired:
        """Pair samples of both surfaces, both ways."""
        goal, normals = self._goal, self._normals()
        own = self._features(self._positions, normals, self._codes)
        there, back = self._goal_tree.query(own)[1], cKDTree(own).query(self._goal_features)[1]
        apart, apart_back = goal.positions[there] - self._positions, goal.positions - self._positions[back]
        alike = (goal.codes[there] == self._codes) & ((goal.normals[there] * normals).sum(1) > _COSINE)
        weight = _weights(apart, alike, limit * goal.reach[there]) / len(apart)
        alike = (goal.codes == self._codes[back]) & ((goal.normals * normals[back]).sum(1) > _COSINE)
        weight_back = _BACK * _weights(apart_back, alike, limit * goal.reach) / len(apart_back)
        merged = np.bincount(back, weight_back, len(apart))
        sums = np.stack([np.bincount(back, weight_back * apart_back[:, axis], len(apart)) for axis in range(3)], 1)
        used, used_back = np.flatnonzero(weight), np.flatnonzero(merged)
        mean = sums[used_back] / merged[used_back, None]
        planes = np.concatenate([goal.normals[there[used]], normals[used_back]])
        return _Paired(
            np.concatenate([used, used_back]),
            planes,
            (planes * np.concatenate([apart[used], mean])).sum(1),
            np.concatenate([weight[used], merged[used_back]]),
            weight[:, None] * apart + sums,
            weight + merged,
        )

    def _add_pairs(self, system: _System, level: _Level, limit: float) -> None:
        pairs = self._paired(limit)
        system.add(level.rows_along(pairs.samples, pairs.normals), (1 - _POINTWISE) * pairs.weights, pairs.apart)
        mean = pairs.pull / np.maximum(pairs.weight, _TINY)[:, None]
        for axis, terms in enumerate(level.terms):
            system.add(terms, _POINTWISE * pairs.weight, mean[:, axis])

    def _add_jacobians(self, system: _System, level: _Level, share: float) -> None:
        """Add that Jacobians stay near good ones, and of what is built, that level and upright faces stay so."""
        unit = self._diagonal**2 / _JACOBIANS
        stiffness = in_ratio(_STIFFNESS, share) * unit
        weights = np.broadcast_to(stiffness * self._stiffer, (3, 3, _JACOBIANS))
        goals = (_in_range(self._jacobians) - self._jacobians).transpose(1, 2, 0)
        if self._built:
            upward = np.abs(self._rest_normals[self._chosen, 1])
            square = np.where((upward > _FLAT) | (upward < _UPRIGHT), 1.0, _LEANING)
            mixing = np.zeros((3, 3, 1))
            mixing[1, ::2] = mixing[::2, 1] = 1.0
            level_weights = _LEVEL * unit * square * mixing
            goals = (weights * goals - level_weights * self._jacobians.transpose(1, 2, 0)) / (weights + level_weights)
            weights = weights + level_weights
        system.add(level.slopes, weights.ravel(), goals.ravel())

    def _unfolded(self, level: _Level, step: Floats) -> float:
        """Return how much of a step can be gone without a fold, and stiffen where all of it would fold."""
        change = level.change(step)
        now, full = np.linalg.det(self._jacobians), np.linalg.det(self._jacobians + change)
        least = np.linalg.svd(self._jacobians + change, compute_uv=False)[:, 2]
        folds = (least < _LEAST_STRETCH) | (full < _LEAST_DET)
        self._stiffer = np.where(
            folds, np.minimum(self._stiffer * _STIFFER, _STIFFEST), np.maximum(self._stiffer * _SOFTER, 1.0)
        )
        allowed, length = np.minimum(_LEAST_DET, 0.5 * now), 1.0
        while length > _SHORTEST:
            if (np.linalg.det(self._jacobians + length * change) > allowed).all():
                return length
            length *= _SHORTER
        return 0.0


def in_ratio(ends: tuple[float, float], share: float) -> float:
    """Return the value at a share of the way between two, in equal ratios."""
    return float(ends[0] * (ends[1] / ends[0]) ** share)


def _weights(apart: Floats, alike: Flags, limits: Floats) -> Floats:
    """Return the weights (P,) of pairs by their differences (P, 3)."""
    lengths = np.linalg.norm(apart, axis=1)
    ratio = lengths / np.maximum(limits, _TINY)
    return np.asarray((alike & (lengths < limits)) / np.sqrt(1 + (2 * ratio) ** 2))


def _in_range(jacobians: Floats) -> Floats:
    """Return the nearest Jacobians (J, 3, 3) that do not reflect and whose stretches are in the range."""
    u, stretches, v = np.linalg.svd(jacobians)
    reflects = np.linalg.det(u @ v) < 0
    u[reflects, :, 2] *= -1
    stretches[reflects, 2] *= -1
    return np.asarray((u * np.clip(stretches, *_STRETCH)[:, None, :]) @ v)
