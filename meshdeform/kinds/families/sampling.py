"""Draw shapes near the members of a family, and measure how plausible shapes are under its Beta shape machine.

A shape has proportions between a member and one of those that are nearest to it, each part by a share of its own, and
each part is given by another member whose part is of a like form. Members take turns, so that no few of them are behind
all shapes. Gibbs sampling of the machine (Huang 2017, section 3.4) mixed kinds, and covered less of the members that it
had not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.kinds.families.family_file import FamilyFile
from meshdeform.kinds.families.machine import HIGH, LOW, BetaMachine
from meshdeform.kinds.families.placing import axis_fit

_Floats = NDArray[np.float64]

_NEAREST, _LIKE, _SHARED = 5, 0.5, 0.75
"""A shape lies beside one of so many; a part is given by one of this share of the members, the most alike, that have at
least this share of its points."""
_BEYOND = 0.25
"""How far beyond one of two members a part may lie, as a share of the way between them."""
LACKING = 0.2
"""Share of the distance for points that only one of two members has."""
_INSIDE = 1e-4, 1 - 1e-4
"""Coordinates stay away from the ends, where their logarithms diverge."""


@dataclass(frozen=True)
class Drawn:
    """A shape by its points, and where its parts may come from."""

    points: _Floats  # (K, 3) float64: in the frame
    exists: NDArray[np.bool_]  # (K,) bool
    sources: dict[int, list[int]]  # the members that may give each part, the first one that can does


def distances(family: FamilyFile, member: int, known: NDArray[np.bool_] | None = None) -> _Floats:
    """Return how far all members (T,) are from one, by all points or by the known ones (K,).

    It is the mean distance of points that both have, and a share of what only one has.
    """
    chosen = np.ones(len(family.labels), bool) if known is None else known
    points, exists = family.points[:, chosen], family.exists[:, chosen]
    both = exists & exists[member]
    apart = np.linalg.norm(points - points[member], axis=2)
    mean = (apart * both).sum(1) / np.maximum(both.sum(1), 1)
    return np.where(both.any(1), mean + LACKING * (exists != exists[member]).mean(1), 1.0)


def sampled(family: FamilyFile, number: int, seed: int) -> Drawn:
    """Draw the shape of a number, which has the proportions of a member whose turn it is, or nearly."""
    turns = np.random.default_rng([seed, len(family.names)]).permutation(len(family.names))
    return _beside(family, int(turns[number % len(turns)]), np.random.default_rng([seed, number]))


def completed(family: FamilyFile, member: int, keep: Sequence[int], random: np.random.Generator) -> Drawn:
    """Draw a shape with some parts of a member; the others are of a shape beside one whose parts are like them."""
    known = np.isin(family.labels, keep)
    near = _nearest(distances(family, member, known), member)
    base = int(random.choice(near))
    draw = _beside(family, base, random)
    own, common = family.points[member], known & family.exists[member] & family.exists[base]
    scale, shift = axis_fit(family.points[base][common], own[common]) if common.any() else (np.ones(3), np.zeros(3))
    points = np.where(known[:, None], own, draw.points * scale + shift)
    sources = {part: members for part, members in draw.sources.items() if part not in keep}
    return Drawn(points, np.where(known, family.exists[member], draw.exists), sources)


def between(family: FamilyFile, pair: Sequence[int], share: float) -> Drawn:
    """Return a shape between two members, with the parts of the nearer one; at 0 and 1 it is one of them."""
    one, other = family.exists[list(pair)]
    # Where only one of the two has a point, its place counts alone.
    weight = np.where(one == other, share, other)[:, None] if 0 < share < 1 else share
    points = (1 - weight) * family.points[pair[0]] + weight * family.points[pair[1]]
    near = pair[round(share)]
    return Drawn(points, family.exists[near], {int(part): [near] for part in np.unique(family.segments[near])})


def _nearest(apart: _Floats, member: int) -> NDArray[np.int64]:
    """Return the members that are nearest to one, without itself."""
    order = np.argsort(np.where(np.arange(len(apart)) == member, np.inf, apart), kind="stable")
    return order[: min(_NEAREST, len(apart) - 1)]


def _beside(family: FamilyFile, member: int, random: np.random.Generator) -> Drawn:
    """Draw a shape with proportions between a member and one near to it, and the members that give its parts."""
    apart = distances(family, member)
    other = int(random.choice(_nearest(apart, member)))
    shares = random.uniform(-_BEYOND, 1 + _BEYOND, len(family.parts))
    both = (family.exists[member] & family.exists[other])[:, None]
    way = both * (family.points[other] - family.points[member])
    points = family.points[member] + shares[family.labels, None] * way
    sources, taken = dict[int, list[int]](), {member}
    parts = np.unique(family.segments[member]).tolist()
    for part in random.permutation(parts).tolist():
        alike = [each for each in like_parts(family, member, part) if each not in taken]
        fit = alike[: max(1, round(_LIKE * len(alike)))]
        first = int(random.choice(fit)) if fit else member
        taken.add(first)
        sources[part] = [first, *(each for each in alike if each != first), member]
    return Drawn(points, family.exists[member], {part: sources[part] for part in parts})


def like_parts(family: FamilyFile, member: int, part: int) -> list[int]:
    """Return the members that have a part, the most alike in form first: that of a member, scaled along the axes."""
    own = family.labels == part
    there = family.exists[:, own] & family.exists[member, own]
    points, unlike = family.points[:, own], np.full(len(family.names), np.inf)
    for each in np.flatnonzero(there.sum(1) >= max(_SHARED * there[member].sum(), 1)):
        source, target = points[each, there[each]], points[member, there[each]]
        scale, shift = axis_fit(source, target)
        apart = np.linalg.norm(source * scale + shift - target, axis=1).mean()
        unlike[each] = apart + LACKING * (family.exists[each, own] != family.exists[member, own]).mean()
    order = np.argsort(unlike, kind="stable").tolist()
    return [each for each in order if np.isfinite(unlike[each]) and (family.segments[each] == part).any()]


def to_machine(points: Tensor, scaling: Tensor) -> Tensor:
    """Scale points (..., 3) of the frame into the machine's interval."""
    return (LOW + (HIGH - LOW) * (points - scaling[:3]) / scaling[3]).clamp(*_INSIDE)


class FreeEnergy:
    """The free energy of shapes under a machine, compared with that of the family's members.

    The surface part has no closed form with three layers; its mean-field bound is used: energy less entropy under the
    inferred distribution. Both parts are means over points and relative to the members' means of the same points, so
    that shapes with different points compare.

    Parameters
    ----------
    points : (T, K, 3) float32
    exists : (T, K) float32
        The members.
    """

    def __init__(self, machine: BetaMachine, points: Tensor, exists: Tensor) -> None:
        self._machine = machine
        energy, _ = self._energies(points, exists)
        present = exists.repeat_interleave(3, 1)
        self._mean = (energy * present).sum(0) / present.sum(0).clamp_min(1.0)
        self.members = self(points, exists)

    def __call__(self, points: Tensor, exists: Tensor) -> Tensor:
        """Return the free energy (S,) of shapes; lower is more plausible."""
        energy, hidden = self._energies(points, exists)
        present = exists.repeat_interleave(3, 1)
        count = present.sum(1).clamp_min(1.0)
        surface = ((energy - self._mean) * present).sum(1) / count + hidden / count
        return surface + self.structure(exists)

    def structure(self, exists: Tensor) -> Tensor:
        """Return the exact free energy (S,) of which points exist, per point."""
        w = self._machine.weights
        latent = torch.nn.functional.softplus(w["g0"] + exists @ w["eg"]).sum(1)
        return -(exists @ w["e0"] + latent) / exists.shape[1]

    def plausibility(self, energy: float) -> float:
        """Return the share of members that are less plausible, 0 to 1."""
        return float((self.members > energy).float().mean())

    def _energies(self, points: Tensor, exists: Tensor) -> tuple[Tensor, Tensor]:
        """Return the energy of each coordinate (S, V), and that of the hidden units less their entropy (S,)."""
        machine, w = self._machine, self._machine.weights
        hidden = machine.infer(points, exists)
        alpha, beta = machine.exponents(hidden.h1)
        flat = points.reshape(len(points), -1)
        low, high = flat.log() - w["m0"], (1 - flat).log() - w["m1"]
        energy = -((alpha - 1) * low + (beta - 1) * high)
        couplings = ((hidden.h1 @ w["w12"]) * hidden.h2).sum(1) + ((hidden.h2 @ w["w23"]) * hidden.h3).sum(1)
        biases = sum(h @ w[name] for h, name in ((hidden.h1, "w1"), (hidden.h2, "w2"), (hidden.h3, "w3")))
        entropy = sum(_entropy(h) for h in (hidden.h1, hidden.h2, hidden.h3))
        return energy, -(couplings + biases + entropy)


def _entropy(p: Tensor) -> Tensor:
    p = p.clamp(1e-7, 1 - 1e-7)
    return -(p * p.log() + (1 - p) * (1 - p).log()).sum(1)
