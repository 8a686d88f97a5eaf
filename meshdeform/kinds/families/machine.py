"""The Beta shape machine: a Boltzmann machine over corresponding surface points, and one over their existence.

The visible coordinates are Beta distributed given the first hidden layer, whose units see the points of one part each;
two more layers stand above. The structure part has one layer over which points exist.

Source: Huang, Kalogerakis and Marlin 2015, section 4; the thesis, appendix C. Symbols as there.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

LOW, HIGH = 0.25, 0.75
"""Coordinates are scaled into this interval, away from the ends where the logarithms diverge."""
STRONGEST = 4000.0
"""Greatest sum of the exponents of a coordinate: a standard deviation of 0.4 % of the diagonal of all members."""
_ROUNDS = 3
_SHARED = 0.2
"""Share of the exponents that comes from the first layer at the start."""
_APART, _SPREAD = 2.0, 0.4
"""Standard deviation over the shapes of the inputs of the layers above at the start, and the one of the units below
them from which on it is reached: larger weights in place of it would feed back more than they bring up."""


@dataclass(frozen=True)
class Hidden:
    """Probabilities of the hidden units of T shapes: (T, M), (T, N) and (T, O) float32."""

    h1: Tensor
    h2: Tensor
    h3: Tensor


def layer_sizes(points: int) -> tuple[int, int, int]:
    """Return the sizes of the hidden layers for K points: 3K/10, a fifth of that, and that divided by 2.5."""
    first = max(3 * points // 10, 2)
    second = max(first // 5, 2)
    return first, second, max(round(second / 2.5), 2)


class BetaMachine:
    """Parameters of the machine.

    Attributes
    ----------
    weights : dict of name to Tensor
        `a0`, `b0` (V,); `a`, `b`, `c`, `d` (V, M), not negative; `w1` (M,), `w2` (N,), `w3` (O,); `w12` (M, N),
        `w23` (N, O); `e0` (K,), `g0` (R,), `eg` (K, R). V is 3 K: x, y and z of point 0, then of point 1, and so on.
        `m0`, `m1` (V,) are the means of ln D and ln(1 - D), from which the first layer sees differences, so that its
        input does not depend on how many points exist.
    sees : (V, M) float32
        1 where a unit of the first layer sees a coordinate.
    """

    def __init__(self, weights: dict[str, Tensor], sees: Tensor) -> None:
        self.weights, self.sees = weights, sees

    @classmethod
    def start(
        cls,
        points: Tensor,
        exists: Tensor,
        labels: Tensor,
        random: torch.Generator,
        sizes: tuple[int, int, int] | None = None,
    ) -> BetaMachine:
        """Begin with the mean and the variance of each coordinate, and random projections for the hidden units.

        Parameters
        ----------
        points : (T, K, 3) float32 in (0, 1)
        exists : (T, K) float32, 0 or 1
        labels : (K,) int64
            The part of each point. Units of the first layer are shared out among parts by their numbers of points.
        sizes : tuple of int, optional
            Default: `layer_sizes`.
        """
        count = points.shape[1]
        m, n, o = sizes or layer_sizes(count)
        # Unit i belongs to the part of the point at its place among all points in the order of their parts.
        ordered = labels[labels.argsort(stable=True)]
        owner = ordered[((torch.arange(m) + 0.5) * count / m).long()]
        sees = (labels[:, None] == owner).float().repeat_interleave(3, 0)
        weight = exists.sum(0).clamp_min(1.0)
        mean = (points * exists[:, :, None]).sum(0) / weight[:, None]
        spread = ((points - mean).square() * exists[:, :, None]).sum(0) / weight[:, None] + 1e-6
        strength = (mean * (1 - mean) / spread - 1).clamp(4.0, STRONGEST)
        share = exists.mean(0).clamp(0.02, 0.98)

        # Each unit begins as a random projection of its part's points, so that no two units learn the same.
        each = _SHARED * strength.reshape(-1, 1) / sees.sum(1, keepdim=True).clamp_min(1.0)

        # Units of the structure part begin as random projections too, of unit variance over the shapes. Small weights
        # would stay small: the penalty on what tells neighbours apart is larger than what their units learn.
        latent = torch.randn(count, n, generator=random)
        latent /= (exists @ latent).std(0, correction=0).clamp_min(1.0)

        weights = {
            "a0": ((mean - _SHARED / 2) * strength).clamp_min(0.1).reshape(-1),
            "b0": ((1 - mean - _SHARED / 2) * strength).clamp_min(0.1).reshape(-1),
            **{name: torch.rand(3 * count, m, generator=random) * each * sees for name in "abcd"},
            "m0": (points.log() * exists[:, :, None]).sum(0).div(weight[:, None]).reshape(-1),
            "m1": ((1 - points).log() * exists[:, :, None]).sum(0).div(weight[:, None]).reshape(-1),
            "e0": (share / (1 - share)).log(),
            "g0": -exists.mean(0) @ latent,
            "eg": latent,
        }
        machine = cls(weights, sees)
        machine._stack(torch.sigmoid(machine._pull(points, exists)), n, o, random)
        return machine

    def _stack(self, h1: Tensor, second: int, third: int, random: torch.Generator) -> None:
        """Begin the second and third layer as random projections of the layers below, with inputs of mean 0."""
        # From small weights they learned next to nothing: reconstructions from the top were one and the same shape, and
        # the half of the epochs that starts there drove the first layer away from the members.

        def projection(below: Tensor, size: int) -> Tensor:
            weights = torch.randn(below.shape[1], size, generator=random)
            weights -= weights.mean(1, keepdim=True)  # so that what comes back down is 0 if all are equally likely
            spread = (below @ weights).std(0, correction=0)
            return _APART * weights / spread.clamp_min(_SPREAD * below.shape[1] ** 0.5)

        w12 = projection(h1, second)
        h2 = torch.sigmoid(h1 @ w12 - (h1 @ w12).mean(0))
        w23 = projection(h2, third)
        h3 = torch.sigmoid(h2 @ w23 - (h2 @ w23).mean(0))
        self.weights |= {
            "w12": w12,
            "w23": w23,
            "w1": -(h2 @ w12.T).mean(0),
            "w2": -(h1 @ w12).mean(0) - (h3 @ w23.T).mean(0),
            "w3": -(h2 @ w23).mean(0),
        }

    def infer(self, points: Tensor, exists: Tensor) -> Hidden:
        """Return the hidden units given points (T, K, 3) and existence (T, K): mean field from the bottom up."""
        pull = self._pull(points, exists)
        w = self.weights
        h2 = torch.zeros(len(points), len(w["w2"]))
        h3 = torch.zeros(len(points), len(w["w3"]))
        for _ in range(_ROUNDS):
            h1 = torch.sigmoid(w["w1"] + pull + h2 @ w["w12"].T)
            h2 = torch.sigmoid(w["w2"] + h1 @ w["w12"] + h3 @ w["w23"].T)
            h3 = torch.sigmoid(w["w3"] + h2 @ w["w23"])
        return Hidden(h1, h2, h3)

    def reconstruct(self, h3: Tensor, exists: Tensor, h1: Tensor | None = None) -> tuple[Tensor, Hidden]:
        """Return expected points (T, K, 3) and the hidden units given the top layer (T, O): three rounds.

        `h1` (T, M), if given, replaces what the first way down finds for the first layer, and one round is made.
        """
        w = self.weights
        h2 = torch.sigmoid(w["w2"] + h3 @ w["w23"].T)
        rounds = _ROUNDS if h1 is None else 1
        if h1 is None:
            h1 = torch.sigmoid(w["w1"] + h2 @ w["w12"].T)  # the first round knows no points
        for _ in range(rounds):
            points = self.expected(h1)
            h1 = torch.sigmoid(w["w1"] + self._pull(points, exists) + h2 @ w["w12"].T)
            h2 = torch.sigmoid(w["w2"] + h1 @ w["w12"] + h3 @ w["w23"].T)
            h3 = torch.sigmoid(w["w3"] + h2 @ w["w23"])
        return self.expected(h1), Hidden(h1, h2, h3)

    def exponents(self, h1: Tensor) -> tuple[Tensor, Tensor]:
        """Return alpha and beta (T, V) of the coordinates given the first layer (T, M)."""
        w, off = self.weights, 1 - h1
        alpha = w["a0"] + h1 @ w["a"].T + off @ w["c"].T
        beta = w["b0"] + h1 @ w["b"].T + off @ w["d"].T
        return alpha.clamp_min(1e-3), beta.clamp_min(1e-3)

    def expected(self, h1: Tensor) -> Tensor:
        """Return the expectation of the points (T, K, 3) given the first layer."""
        alpha, beta = self.exponents(h1)
        return (alpha / (alpha + beta)).reshape(len(h1), -1, 3)

    def expected_logs(self, h1: Tensor) -> tuple[Tensor, Tensor]:
        """Return the expectations (T, V) of ln D and ln(1 - D) given the first layer.

        The logarithm of the expectation, which the thesis uses, is larger than this, and shrinks all exponents.
        """
        alpha, beta = self.exponents(h1)
        total = torch.digamma(alpha + beta)
        return torch.digamma(alpha) - total, torch.digamma(beta) - total

    def structure(self, exists: Tensor) -> Tensor:
        """Return the probabilities (T, R) of the structure's latent units given existence (T, K)."""
        return torch.sigmoid(self.weights["g0"] + exists @ self.weights["eg"])

    def existence(self, latent: Tensor) -> Tensor:
        """Return the probability (T, K) that each point exists given the structure's latent units (T, R)."""
        return torch.sigmoid(self.weights["e0"] + latent @ self.weights["eg"].T)

    def log_likelihood(self, points: Tensor, exists: Tensor) -> Tensor:
        """Return the mean log density (T,) of the existing coordinates given the inferred hidden units."""
        alpha, beta = self.exponents(self.infer(points, exists).h1)
        known = exists.repeat_interleave(3, 1)
        flat = points.reshape(len(points), -1)
        norm = torch.lgamma(alpha + beta) - torch.lgamma(alpha) - torch.lgamma(beta)
        density = norm + (alpha - 1) * flat.log() + (beta - 1) * (1 - flat).log()
        return (density * known).sum(1) / known.sum(1).clamp_min(1.0)

    def _pull(self, points: Tensor, exists: Tensor) -> Tensor:
        """Return the part of the first layer's input (T, M) that comes from the points."""
        known = exists.repeat_interleave(3, 1)
        flat = points.reshape(len(points), -1)
        w = self.weights
        low, high = (flat.log() - w["m0"]) * known, ((1 - flat).log() - w["m1"]) * known
        return low @ (w["a"] - w["c"]) + high @ (w["b"] - w["d"])
