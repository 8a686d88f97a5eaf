"""Draw shapes from a Beta shape machine: samples, what lies between two shapes, and what completes a part of one.

Source: Huang 2017, section 3.4 and appendix C. Sampling is Gibbs sampling in blocks: coordinates given the first
layer, first and third layer given the coordinates and the second, second given the other two. The coordinates of a
sample are their expectation given its first layer, and a draw of what that leaves unexplained in the members.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from meshdeform.kinds.families.machine import HIGH, LOW, BetaMachine

_INSIDE = 1e-4, 1 - 1e-4
"""Coordinates stay away from the ends, where their logarithms diverge."""


@dataclass(frozen=True)
class State:
    """Binary hidden units of S chains: (S, M), (S, N) and (S, O) float32."""

    h1: Tensor
    h2: Tensor
    h3: Tensor


@dataclass(frozen=True)
class Drawn:
    """A shape by its points."""

    points: Tensor  # (K, 3) float32: in the machine's interval
    exists: Tensor  # (K,) float32: 0 or 1


@dataclass(frozen=True)
class Unexplained:
    """What the first layer leaves unexplained in the members: a normal distribution, each part by itself.

    Members of one kind differ mostly in this, and the expectation alone gives nearly the same member of a kind again
    and again. Normal coefficients of all members, in place of what one of them has, make no copies of it; and since
    each part has coefficients of its own, proportions come together that no member has.
    """

    factors: Tensor
    """(T, V) float32: what is unexplained in each member, over the root of how many members have the point: their
    products are the covariance of each coordinate with the others."""
    labels: Tensor  # (K,) int64: the part of each point

    @classmethod
    def of(cls, machine: BetaMachine, points: Tensor, exists: Tensor, labels: Tensor) -> Unexplained:
        """Measure it on the members (T, K, 3) and (T, K)."""
        apart = (points - machine.expected(machine.infer(points, exists).h1)) * exists[:, :, None]
        apart /= exists.sum(0).clamp_min(1.0).sqrt()[:, None]
        return cls(apart.reshape(len(points), -1), labels)

    def draw(self, random: np.random.Generator) -> Tensor:
        """Draw a displacement of the points (K, 3)."""
        parts = int(self.labels.max()) + 1
        normal = torch.from_numpy(random.normal(size=(parts, len(self.factors)))).float()
        own = torch.arange(len(self.labels))
        return (normal @ self.factors).reshape(parts, -1, 3)[self.labels, own]


def to_machine(points: Tensor, scaling: Tensor) -> Tensor:
    """Scale points (..., 3) of the frame into the machine's interval."""
    return LOW + (HIGH - LOW) * (points - scaling[:3]) / scaling[3]


def to_frame(points: Tensor, scaling: Tensor) -> Tensor:
    """Return points (..., 3) in the frame; the inverse of `to_machine`."""
    return (points - LOW) / (HIGH - LOW) * scaling[3] + scaling[:3]


def _coin(probability: Tensor, random: np.random.Generator) -> Tensor:
    return torch.from_numpy(random.random(probability.shape) < probability.numpy()).float()


def gibbs(
    machine: BetaMachine,
    state: State,
    exists: Tensor,
    rounds: int,
    random: np.random.Generator,
    fixed: tuple[Tensor, Tensor] | None = None,
) -> State:
    """Do rounds of Gibbs sampling over coordinates and hidden units.

    Parameters
    ----------
    state : State
        Where the chains begin.
    exists : (S, K) float32
        Coordinates of other points are not drawn.
    fixed : ((S, K, 3), (S, K)) float32, optional
        Points, and 1 for those that keep their places.
    """
    w, shape = machine.weights, (len(exists), -1, 3)
    for _ in range(rounds):
        alpha, beta = (each.double().numpy() for each in machine.exponents(state.h1))
        drawn = np.clip(random.beta(alpha, beta), 1e-6, 1 - 1e-6)
        points = torch.from_numpy(drawn).float().reshape(shape)
        if fixed is not None:
            points = torch.where(fixed[1][:, :, None] > 0, fixed[0], points)
        h1 = _coin(torch.sigmoid(w["w1"] + machine._pull(points, exists) + state.h2 @ w["w12"].T), random)
        h3 = _coin(torch.sigmoid(w["w3"] + state.h2 @ w["w23"]), random)
        h2 = _coin(torch.sigmoid(w["w2"] + h1 @ w["w12"] + h3 @ w["w23"].T), random)
        state = State(h1, h2, h3)
    return state


def _existing(
    machine: BetaMachine, exists: Tensor, rounds: int, random: np.random.Generator, known: Tensor | None = None
) -> Tensor:
    """Draw which points exist (S, K) by Gibbs sampling of the structure part, from where it is; `known` ones stay."""
    start = exists
    for _ in range(rounds):
        latent = _coin(machine.structure(exists), random)
        exists = _coin(machine.existence(latent), random)
        if known is not None:
            exists = torch.where(known > 0, start, exists)
    if not rounds:
        return exists
    # The last step takes what is more likely: single points that come and go at random are no feature of a shape.
    likely = (machine.existence(_coin(machine.structure(exists), random)) > 0.5).float()
    return likely if known is None else torch.where(known > 0, start, likely)


def sampled(
    machine: BetaMachine,
    points: Tensor,
    exists: Tensor,
    unexplained: Unexplained,
    rounds: int,
    random: np.random.Generator,
) -> Drawn:
    """Draw a shape: two chains, over surface and structure, that begin at random members; then what they leave open.

    Parameters
    ----------
    points : (T, K, 3) float32
        The members in the machine's interval.
    exists : (T, K) float32
    unexplained : Unexplained
        Of the same members.
    rounds : int
        Rounds of Gibbs sampling. More rounds forget more of the members.
    """
    first = int(random.integers(len(points)))
    found = _existing(machine, exists[first : first + 1], rounds, random)
    hidden = machine.infer(points[first : first + 1], exists[first : first + 1])
    state = State(*(_coin(each, random) for each in (hidden.h1, hidden.h2, hidden.h3)))
    state = gibbs(machine, state, found, rounds, random)
    made = machine.expected(state.h1)[0] + unexplained.draw(random)
    return Drawn(made.clamp(*_INSIDE), found[0])


def between(machine: BetaMachine, points: Tensor, exists: Tensor, share: float) -> Drawn:
    """Return a shape between two: hidden units are blended, and what the machine does not know of the two is too.

    At 0 and 1 it is the first and the second shape, to the last bit.

    Parameters
    ----------
    points : (2, K, 3) float32
    exists : (2, K) float32
    share : float
        0 to 1.
    """
    if share in {0.0, 1.0}:
        return Drawn(points[int(share)], exists[int(share)])
    first = machine.infer(points, exists).h1
    middle = machine.expected((1 - share) * first[:1] + share * first[1:])[0]
    one, other = points - machine.expected(first)
    # Where only one of the two has a point, what the machine does not know of it counts in full.
    weight = torch.where(exists[0] == exists[1], torch.tensor(share), exists[1])[:, None]
    made = middle + (1 - weight) * one + weight * other
    return Drawn(made.clamp(*_INSIDE), exists[round(share)])


def completed(
    machine: BetaMachine,
    points: Tensor,
    exists: Tensor,
    known: Tensor,
    unexplained: Unexplained,
    rounds: int,
    random: np.random.Generator,
) -> Drawn:
    """Draw a shape that has the known points of another.

    Parameters
    ----------
    points : (K, 3) float32
    exists : (K,) float32
        Of the shape whose points are known.
    known : (K,) float32
        1 for the points of parts that are kept, whether they exist or not.
    unexplained : Unexplained
        Of the family's members.
    """
    mean = torch.sigmoid(machine.weights["e0"])
    start = torch.where(known > 0, exists, mean)[None]
    found = _existing(machine, start, max(rounds, 1), random, known[None])
    seen = (exists * known)[None]
    hidden = machine.infer(points[None], seen)
    state = State(*(_coin(each, random) for each in (hidden.h1, hidden.h2, hidden.h3)))
    state = gibbs(machine, state, found, max(rounds, 1), random, (points[None], seen))
    made = (machine.expected(state.h1)[0] + unexplained.draw(random)).clamp(*_INSIDE)
    return Drawn(torch.where(seen[0, :, None] > 0, points, made), found[0])


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
