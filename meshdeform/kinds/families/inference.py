"""Mean-field inference of deformations, templates, correspondences and segmentation.

The equations are those of the thesis, appendix C. Two things are solved exactly instead of by repeated updates: given
correspondences, the means of all deformed points of a shape are the solution of one linear system per axis, which is
the fixed point of the updates one by one; the fixed point of the template's update is the mean of the deformed points.

Shapes are compared in a common box: each is scaled along x, y and z to the mean bounding box of the collection. That is
the rough alignment from which the inference starts, and smoothness then costs nothing for a shape that is only wider.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from meshdeform.kinds.families.collection import Collection
from meshdeform.kinds.families.template import Template, first_template, graph

_EPSILON = 1e-2
"""Price of a correspondence whose part label disagrees."""
_NEAREST_SAMPLES, _NEAREST_POINTS = 100, 20
"""Correspondences that are not between such neighbours have the probability 0."""

_S1, _S2 = 0.08**2, 0.05**2
_LEAST_S1, _LEAST_S2, _LEAST_S3 = 0.006**2, 0.02**2, 2.0
"""Without a bound below, smoothness and correspondences agree on shapes that do not bend. The one of the
features, whose variance over the collection is 1, makes up for features that are counted as if each told more."""
_TIGHTER, _TIGHTEST = 0.85, 0.03
"""The bound above S1 falls by this factor in each round, down to the square of the second number."""
_LEAST_ALIKE = 0.05
_TOLD, _NOT_TOLD = 0.9, 0.02
"""Probabilities of what readings say of a part: at most, and of each other part at least."""
_ROUNDS = 3
_CROWD, _GIVE, _MOST_GIVEN = 2.0, 0.5, 8.0
"""A point that more samples than `_CROWD` times the mean want passes samples on to points beside it. Without this, a
few points whose features are like the mean of all take the samples of the others, which then seem not to exist."""


_MOSTLY = 0.8


@dataclass
class Inference:
    """The state of the inference over T shapes with P samples, K template points and L parts."""

    collection: Collection
    template: Template
    given: Tensor  # (T, P) int64: given parts of samples; -1 where they are to be found
    prior: Tensor  # (T, P, L) float32: logarithms of what is known of the parts of samples before; or (0,) for nothing
    deformed: Tensor  # (T, K, 3) float32: E[D], in the common box
    variance: Tensor  # (T, K, 3) float32: diagonal of cov[D]
    mass: Tensor  # (T, K) float32: how many samples correspond to each point: the sum of Q(U)
    parts: Tensor  # (T, P, L) float32: Q(S)
    crowding: Tensor
    """(T, K) float32: logarithm, at most 0, of the factor by which a crowded point is wanted less (`_CROWD`)."""
    likelihood: Tensor  # (T,) float32: mean log-likelihood of a sample
    # Diagonal covariances of data, smoothness and features
    s1: Tensor  # (3,) float32
    s2: Tensor  # (3,) float32
    s3: Tensor  # (F,) float32
    iteration: int = 0
    boxed: Tensor = field(init=False)
    edges: Tensor = field(init=False)
    alike: Tensor = field(init=False)

    def __post_init__(self) -> None:
        self.boxed = self.collection.points * self.box_scale()
        self.edges = graph(self.template.points, self.template.labels)
        self.alike = _alike(self.collection)

    @classmethod
    def start(
        cls, collection: Collection, labels: Tensor, count: int, parts: int, prior: Tensor | None = None
    ) -> Inference:
        """Make the templates and begin with each shape's box.

        Parameters
        ----------
        labels : (T, P) int64
            Given parts of samples, -1 elsewhere.
        prior : (T, P, L) float32, optional
            Logarithms of what is known of the parts of all samples.
        count : int
            Number of template points K.
        parts : int
            Number of parts L.
        """
        shapes, samples = labels.shape
        mean = collection.boxes.mean(0)
        boxed = collection.points * (mean / collection.boxes)[:, None]
        known = labels if prior is None or bool((labels >= 0).all(1).any()) else _likeliest(prior, labels)
        template = first_template(collection, boxed, known, count, parts)
        begin = torch.full((shapes, samples, parts), 1.0 / parts) if prior is None else prior.softmax(2)
        return cls(
            collection,
            template,
            labels,
            torch.empty(0) if prior is None else prior,
            deformed=template.points.expand(shapes, -1, -1).clone(),
            variance=torch.full((shapes, count, 3), _S1),
            mass=torch.full((shapes, count), samples / count),
            parts=_fixed(begin, labels),
            crowding=torch.zeros(shapes, count),
            likelihood=torch.zeros(shapes),
            s1=torch.full((3,), _S1),
            s2=torch.full((3,), _S2),
            s3=torch.ones(collection.features.shape[2]),
        )

    def box_scale(self) -> Tensor:
        """Return the factors (T, 1, 3) from each shape's own frame to the common box."""
        return (self.collection.boxes.mean(0) / self.collection.boxes)[:, None]

    def _matched(self, score: Tensor, shape: int) -> tuple[Tensor, Tensor]:
        """Return Q(U) (P, K) of one shape, and the log-likelihood (P,) of its samples; `score` is overwritten."""
        score.add_(self.crowding[shape])
        most = score.amax(1, keepdim=True)
        q = score.sub_(most).exp_()
        total = q.sum(1, keepdim=True)
        scale = -0.5 * (self.s1.log().sum() + self.s3.log().sum()) - math.log(q.shape[1])
        return q.div_(total), (most + total.log())[:, 0] + scale

    def step(self) -> dict[str, float]:
        """Do one round of updates over all shapes, and return the mean log-likelihood and what moved."""
        template, count = self.template, len(self.template.points)
        laplacian = torch.diag(self.edges.sum(1)) - self.edges
        pull = laplacian @ template.points
        onehot = torch.nn.functional.one_hot(template.labels, template.parts).float()
        s1, s3 = torch.zeros(3, dtype=torch.float64), torch.zeros_like(self.s3)
        seen, looks = torch.zeros(count), torch.zeros_like(template.features)
        before, agreed = self.deformed.clone(), torch.zeros(count, template.parts)
        bound = max(_S1**0.5 * _TIGHTER**self.iteration, _TIGHTEST) ** 2
        self.s1 = self.s1.clamp_max(bound)
        for t in range(len(self.boxed)):
            score = self._scores(t)
            self._make_room(t, score)
            q, likelihood = self._matched(score, t)
            self.likelihood[t] = likelihood.mean()
            self._label(t, q @ onehot)
            self._deform(t, q, laplacian, pull)
            agreed += q.T @ self.parts[t]
            # sum q (x_p - d_k)^2 = sum q x_p^2 - 2 sum_k d_k (q^T x)_k + sum_k mass_k d_k^2
            x, d, mass, each = self.boxed[t].double(), self.deformed[t].double(), q.sum(0), q.sum(1)
            s1 += each.double() @ x.square() - (2 * (q.T @ self.boxed[t]) * d).sum(0) + mass.double() @ d.square()
            f = self.collection.features[t]
            looks += q.T @ f
            s3 += each @ f.square()
            seen += mass
        samples = self.boxed.shape[0] * self.boxed.shape[1]
        means = looks / seen[:, None].clamp_min(1e-6)
        template.features = torch.where(seen[:, None] > 1e-3, means, template.features)
        # sum q (f_p - f_k)^2 = sum q f_p^2 - sum_k seen_k f_k^2, since f_k is the weighted mean.
        self.s3 = ((s3 - (seen[:, None] * means.square()).sum(0)) / samples).clamp_min(_LEAST_S3)
        self.s1 = (s1 / samples).float().clamp_min(_LEAST_S1)
        template.points = self.deformed.mean(0)
        if len(self.prior) and not bool((self.given >= 0).all(1).any()):
            # The readings of all members decide together what a point is of.
            template.labels = torch.where(seen > 1e-3, agreed.argmax(1), template.labels)
        i, j = torch.nonzero(self.edges, as_tuple=True)
        bend = (self.deformed[:, i] - self.deformed[:, j]) - (template.points[i] - template.points[j])
        self.s2 = bend.square().mean((0, 1)).clamp_min(_LEAST_S2)
        self.iteration += 1
        return {
            "log_likelihood": float(self.likelihood.mean()),
            "moved": float((self.deformed - before).norm(dim=2).mean()),
        }

    def _scores(self, shape: int) -> Tensor:
        """Return how well each sample of one shape fits each point (P, K): log Q(U) without crowding and constant."""
        points, deformed, template = self.boxed[shape], self.deformed[shape], self.template
        size, look = self.s1.sqrt(), self.s3.sqrt()
        # The squares of both terms are those of one distance.
        features = torch.cat([points / size, self.collection.features[shape] / look], 1)
        queries = torch.cat([deformed / size, template.features / look], 1)
        score = torch.cdist(features, queries).square_()
        score += (self.variance[shape] / self.s1).sum(1)
        score *= -0.5
        score += math.log(_EPSILON) * (1 - self.parts[shape][:, template.labels])
        return score.masked_fill_(~_near(points, deformed), -torch.inf)

    def _make_room(self, t: int, score: Tensor) -> None:
        """Update the crowding of one shape: half steps of Sinkhorn's towards at most `_CROWD` times the mean."""
        most = _CROWD * score.shape[0] / score.shape[1]
        for _ in range(2):
            mass = (score + self.crowding[t]).softmax(1).sum(0)
            self.crowding[t] -= _GIVE * (mass / most).clamp_min(1e-6).log()
            self.crowding[t].clamp_(-_MOST_GIVEN, 0.0)

    def _label(self, t: int, matched: Tensor) -> None:
        """Update Q(S) of one shape; `matched` (P, L) sums Q(U) over the points of each part."""
        unary = math.log(_EPSILON) * (1 - matched)
        if len(self.prior):
            unary = unary + self.prior[t]
        alike, near = self.alike[t], self.collection.neighbours[t]
        bond = (alike.log() - (1 - alike).log())[:, :, None]
        q = self.parts[t]
        for _ in range(_ROUNDS):
            q = (unary + (q[near] * bond).sum(1)).softmax(1)
            q = _fixed(q, self.given[t])
        self.parts[t] = q

    def _deform(self, t: int, q: Tensor, laplacian: Tensor, pull: Tensor) -> None:
        """Solve for E[D] of one shape: one system (K, K) for each axis."""
        mass = q.sum(0)
        target = q.T @ self.boxed[t]
        system = torch.diag(mass)[None] / self.s1[:, None, None] + laplacian[None] / self.s2[:, None, None]
        system = system + torch.eye(len(mass)) * (1e-3 / float(self.s1.max()))
        right = (target / self.s1 + pull / self.s2 + 1e-3 / float(self.s1.max()) * self.deformed[t]).T[:, :, None]
        solved = torch.cholesky_solve(right, torch.linalg.cholesky(system))
        self.deformed[t] = solved[:, :, 0].T
        self.variance[t] = 1 / (mass[:, None] / self.s1 + self.edges.sum(1)[:, None] / self.s2)
        self.mass[t] = mass


def reading_prior(read: Tensor, sure: Tensor, names: Tensor, given: Tensor, parts: int) -> Tensor:
    """Return logarithms (T, P, L) of the probabilities of the parts of samples, by readings of their shapes.

    Where shapes with given parts tell how often what is read as one part is of each, their shares count; elsewhere, a
    reading is as right as it is sure.

    Parameters
    ----------
    read : (T, P) int64
        What each sample was read as, one of R; -1 where nothing is known.
    sure : (T, P) float32
        How likely that is right.
    names : (R,) int64
        The part that has the name of what was read; -1 where none has.
    given : (T, P) int64
        Given parts of samples, -1 elsewhere.
    """
    prior = torch.full((*read.shape, parts), 1.0 / parts)
    known = (read >= 0) & (given >= 0)
    for number in range(len(names)):
        here, own = read == number, int(names[number])
        told = given[here & known]
        if len(told):
            counts = torch.bincount(told, minlength=parts).float()
            share = (counts / counts.sum()).clamp_min(_NOT_TOLD).sqrt()  # templates tell the same once more
            prior[here] = share / share.sum()
        elif own >= 0:
            right = (sure[here] * _TOLD).clamp_min(1.0 / parts)[:, None]
            shares = ((1 - right) / max(parts - 1, 1)).expand(-1, parts).clone()
            shares[:, own] = right[:, 0]
            prior[here] = shares
    return prior.log()


def _likeliest(prior: Tensor, given: Tensor) -> Tensor:
    """Return the given or the likeliest part (T, P) of each sample; -1 for shapes of which little is known."""
    best = torch.where(given >= 0, given, prior.argmax(2))
    told = ((prior.amax(2) - prior.amin(2) > 1e-3) | (given >= 0)).float().mean(1) > _MOSTLY
    return torch.where(told[:, None], best, -1) if bool(told.any()) else best


def _near(points: Tensor, deformed: Tensor) -> Tensor:
    """Return flags (P, K) of the pairs of which one is among the nearest of the other."""
    distance = torch.cdist(points, deformed)
    within = _smallest(distance, _NEAREST_POINTS), _smallest(distance.T.contiguous(), _NEAREST_SAMPLES)
    return (distance <= within[0][:, None]) | (distance <= within[1])


def _smallest(distance: Tensor, count: int) -> Tensor:
    """Return the number in each row that `count` of its numbers are not above. NumPy takes a third of `topk`'s time."""
    count = min(count, distance.shape[1])
    return torch.from_numpy(np.partition(distance.numpy(), count - 1, axis=1)[:, count - 1].copy())


def _fixed(parts: Tensor, labels: Tensor) -> Tensor:
    """Return the probabilities with those of given labels set to 0 and 1."""
    known = torch.nn.functional.one_hot(labels.clamp_min(0), parts.shape[-1]).float()
    return torch.where((labels >= 0)[..., None], known, parts)


def _alike(collection: Collection) -> Tensor:
    """Return Phi (T, P, 8): how alike the features of neighbouring samples are, 1 for equal ones."""
    features, near = collection.features, collection.neighbours
    rows = torch.arange(len(features))[:, None, None]
    difference = features[:, :, None] - features[rows, near]
    s5 = difference.square().mean((0, 1, 2)).clamp_min(1e-6)
    distance = (difference.square() / s5).mean(3)
    return torch.exp(-0.5 * distance).clamp(_LEAST_ALIKE, 1 - _LEAST_ALIKE)
