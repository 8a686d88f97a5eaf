"""Learn a Beta shape machine by contrastive divergence."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from meshdeform.kinds.families.machine import STRONGEST, BetaMachine, Hidden

_RATE, _SLOWER, _FASTER = 1e-3, 0.9, 1.1
_RATES = 1e-3, 0.01
"""Bounds of the rate. Errors are noisy, and without a lower bound their noise alone makes the rate vanish."""
_MOMENTUM = (0.5, 0.9)
_ALIKE, _SPARSE = 1e-3, 1e-4
_BLOW_UP = 2.0
"""An error so many times the best one ends a climb: back to the best weights at half the rate."""
_LEAST_RATE = 1e-5
_REACH = 20.0
_OF_STRUCTURE = 30.0
"""Factor of the rate of the structure part, whose gradients are as small as one over the number of shapes. Without it,
it learns little more than how often each point exists, and what only some members have never comes in samples."""
_OF_PRECISION = 3.0
"""Factor of the rate with which all exponents of a coordinate grow or shrink together."""
_MOST_GROWTH = 0.1
"""Most that the logarithm of a coordinate's exponents changes in one epoch."""
_FROM_BELOW = 0.5
"""Share of the epochs that start the reconstruction from the first layer, which is learned before those above it."""
_POSITIVE = ("a0", "b0", "a", "b", "c", "d")


@dataclass
class Learning:
    """The state of the learning."""

    machine: BetaMachine
    points: Tensor  # (T, K, 3) float32 in (0, 1)
    exists: Tensor  # (T, K) float32
    edges: Tensor  # (K, K) float32: neighbouring points, whose weights are drawn together
    random: torch.Generator
    # Momentum of the weights, and the best weights so far
    velocity: dict[str, Tensor]
    best: dict[str, Tensor]
    reach: dict[str, Tensor]
    """Factors of the rate for the exponents, whose statistics vary by about one over the sum of the exponents: a
    diagonal natural gradient. Without it they would need a thousand times as many epochs as the other weights."""
    rate: float = _RATE
    error: float = float("inf")
    best_error: float = float("inf")
    epoch: int = 0

    @classmethod
    def start(
        cls, machine: BetaMachine, points: Tensor, exists: Tensor, edges: Tensor, random: torch.Generator
    ) -> Learning:
        """Begin with the given machine."""
        zero = {name: torch.zeros_like(value) for name, value in machine.weights.items()}
        copy = {name: value.clone() for name, value in machine.weights.items()}
        return cls(machine, points, exists, edges, random, zero, copy, _reach(machine))

    def step(self, epochs: int) -> dict[str, float]:
        """Do one epoch of `epochs`: one update from all shapes; return the error and the rate."""
        machine, points, exists = self.machine, self.points, self.exists
        data = machine.infer(points, exists)
        if not all(bool(each.isfinite().all()) for each in (data.h1, data.h3)):  # no coins can be drawn
            self._adapt(float("nan"))
            self.epoch += 1
            return {"error": self.error, "rate": self.rate}
        top = torch.bernoulli(data.h3, generator=self.random)
        from_below = int(_FROM_BELOW * epochs)
        first = torch.bernoulli(data.h1, generator=self.random) if self.epoch < from_below else None
        if self.epoch == from_below:  # errors of reconstructions from the top are others
            self.error = self.best_error = float("inf")
        reconstructed, hidden = machine.reconstruct(top, exists, first)
        error = float(((points - reconstructed).abs() * exists[:, :, None]).sum() / exists.sum().clamp_min(1) / 3)
        known = exists[:, :, None].expand_as(points).reshape(len(points), -1)
        flat = points.reshape(len(points), -1)
        gradient = self._surface(flat.log(), (1 - flat).log(), data, known, 1.0)
        for name, value in self._surface(*machine.expected_logs(hidden.h1), hidden, known, -1.0).items():
            gradient[name] = gradient[name] + value
        gradient |= self._structure()
        self._adapt(error)
        momentum = _MOMENTUM[0] + (_MOMENTUM[1] - _MOMENTUM[0]) * min(self.epoch / max(epochs / 2, 1), 1.0)
        self._draw_together(gradient)
        self._sharpen(gradient)
        for name in gradient:
            value = machine.weights[name]
            self.velocity[name] = momentum * self.velocity[name]
            self.velocity[name] += self.rate * self.reach.get(name, 1.0) * gradient[name]
            value += self.velocity[name]
            if name in _POSITIVE:
                value.clamp_min_(1e-3 if name in {"a0", "b0"} else 0.0)
        for name in "abcd":
            machine.weights[name] *= machine.sees
        self.epoch += 1
        return {"error": error, "rate": self.rate}

    def finished(self) -> BetaMachine:
        """Return the machine with the best weights."""
        return BetaMachine({name: value.clone() for name, value in self.best.items()}, self.machine.sees)

    def _surface(self, low: Tensor, high: Tensor, h: Hidden, known: Tensor, sign: float) -> dict[str, Tensor]:
        """Return the statistics of the surface part, averaged over the shapes; `low` and `high` are ln D, ln(1 - D)."""
        w = self.machine.weights
        low, high = (low - w["m0"]) * known, (high - w["m1"]) * known
        scale, off = sign / len(low), 1 - h.h1
        return {
            "a0": low.sum(0) * scale,
            "b0": high.sum(0) * scale,
            "a": low.T @ h.h1 * scale,
            "b": high.T @ h.h1 * scale,
            "c": low.T @ off * scale,
            "d": high.T @ off * scale,
            "w1": h.h1.sum(0) * scale,
            "w2": h.h2.sum(0) * scale,
            "w3": h.h3.sum(0) * scale,
            "w12": h.h1.T @ h.h2 * scale,
            "w23": h.h2.T @ h.h3 * scale,
        }

    def _structure(self) -> dict[str, Tensor]:
        exists, machine = self.exists, self.machine
        latent = machine.structure(exists)
        existence = machine.existence(torch.bernoulli(latent, generator=self.random))
        again = machine.structure(existence)
        count = len(exists)
        return {
            "e0": (exists - existence).sum(0) / count,
            "g0": (latent - again).sum(0) / count,
            "eg": (exists.T @ latent - existence.T @ again) / count,
        }

    def _draw_together(self, gradient: dict[str, Tensor]) -> None:
        """Add the penalties: neighbouring points have similar weights, and weights are sparse."""
        weights = self.machine.weights
        i, j = torch.nonzero(self.edges.triu(), as_tuple=True)  # each pair once
        for name in ("a0", "b0", "a", "b", "c", "d", "e0", "eg"):
            value = weights[name]
            per_point = value.reshape(len(self.edges), -1)
            apart = (per_point[i] - per_point[j]).sign_()
            signs = torch.zeros_like(per_point).index_add_(0, i, apart).index_add_(0, j, apart, alpha=-1)
            gradient[name] = gradient[name] - _ALIKE * signs.reshape(value.shape)
        for name in ("a", "b", "c", "d", "w12", "w23", "eg"):
            gradient[name] = gradient[name] - _SPARSE * torch.sign(weights[name])

    def _sharpen(self, gradient: dict[str, Tensor]) -> None:
        """Scale all exponents of each coordinate by one factor, which leaves its expectation and changes its variance.

        The statistics hardly vary in this direction: the logarithm of the factor has Fisher information 1/2, whatever
        the exponents are, while steps of the exponents themselves are made for the expectation, and change the variance
        by less than they ought to, by about the sum of the exponents.
        """
        w = self.machine.weights
        slope = w["a0"] * gradient["a0"] + w["b0"] * gradient["b0"]
        for name in "abcd":
            slope = slope + (w[name] * gradient[name]).sum(1)
        total = w["a0"] + w["b0"] + sum(w[name].sum(1) for name in "abcd") / 2
        factor = (2 * _OF_PRECISION * self.rate * slope).clamp(-_MOST_GROWTH, _MOST_GROWTH).exp()
        factor = factor.minimum((STRONGEST / total).clamp_min(1.0))
        for name in ("a0", "b0"):
            w[name] *= factor
        for name in "abcd":
            w[name] *= factor[:, None]

    def _adapt(self, error: float) -> None:
        """Change the rate with the error; keep the best weights, and go back to them after a blow-up."""
        weights = self.machine.weights
        if not error < float("inf") or error > _BLOW_UP * self.best_error:
            for name, value in self.best.items():
                weights[name].copy_(value)
                self.velocity[name].zero_()
            self.rate, self.error = max(self.rate / 2, _LEAST_RATE), self.best_error
            return
        if error < self.best_error:
            self.best_error = error
            self.best = {name: value.clone() for name, value in weights.items()}
        self.rate = min(max(self.rate * (_FASTER if error < self.error else _SLOWER), _RATES[0]), _RATES[1])
        self.error = error


def _reach(machine: BetaMachine) -> dict[str, Tensor]:
    strength = _REACH * (machine.weights["a0"] + machine.weights["b0"])
    shared = strength[:, None] / machine.sees.sum(1, keepdim=True).clamp_min(1.0)
    structure = dict.fromkeys(("e0", "g0", "eg"), torch.tensor(_OF_STRUCTURE))
    return {"a0": strength, "b0": strength, **dict.fromkeys("abcd", shared), **structure}
