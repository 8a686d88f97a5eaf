"""Draw lines as hands do: shaky, broken, beyond their ends, and twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from meshdeform.kinds.sketch.solids import Floats


@dataclass(frozen=True)
class Hand:
    """How a hand draws; lengths are shares of the page."""

    shake: float = 0.004  # standard deviation of the slow waves of a stroke
    shift: float = 0.004  # standard deviation of the place of a stroke
    overshoot: float = 0.015  # greatest length that a stroke has too much or too little at its ends
    # Probabilities that a stroke is broken, that it is drawn twice, and that a short one is left out
    gaps: float = 0.3
    again: float = 0.3
    lost: float = 0.1
    width: float = 0.01

    @classmethod
    def some(cls, random: np.random.Generator) -> Hand:
        """Return a hand between one that is exact and one that is clumsy."""
        clumsy = random.uniform(0, 1.5)
        return cls(
            shake=0.005 * clumsy,
            shift=0.005 * clumsy,
            overshoot=0.02 * clumsy,
            gaps=0.3 * clumsy,
            again=0.4 * random.uniform(0, 1.5),
            lost=0.1 * clumsy,
            width=random.uniform(0.006, 0.016),
        )


def resampled(line: Floats, step: float = 0.012) -> Floats:
    """Return a polyline (N, 2) with points at even distances of about `step`."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0, along[-1], max(int(along[-1] / step), 1) + 1)
    return np.stack([np.interp(at, along, line[:, i]) for i in (0, 1)], 1)


def draw(lines: list[Floats], random: np.random.Generator, hand: Hand | None = None, size: int = 192) -> Image.Image:
    """Draw lines on a white page.

    Parameters
    ----------
    lines : list of (N, 2) floats
        Polylines; the page is 0..1.
    random : numpy Generator
    hand : Hand, optional
        Default: some hand.
    size : int
        Pixels of the square page.

    Returns
    -------
    PIL image of mode L, black on white.
    """
    hand = hand or Hand.some(random)
    page = Image.new("L", (size, size), 255)
    pen = ImageDraw.Draw(page)
    turn = np.eye(2) + random.normal(0, hand.shift * 4, (2, 2))
    for line in lines:
        stroke = resampled((line - 0.5) @ turn + 0.5)
        length = float(np.linalg.norm(np.diff(stroke, axis=0), axis=1).sum())
        if length < 0.004 or (length < 0.06 and random.random() < hand.lost):
            continue
        for _ in range(2 if random.random() < hand.again else 1):
            shaken = _shaken(_ended(stroke, random, hand.overshoot * min(1.0, length * 6)), random, hand)
            for piece in _broken(shaken, random) if random.random() < hand.gaps else [shaken]:
                pixels = [(float(x), float(y)) for x, y in piece * size]
                wide = max(round(hand.width * size * random.uniform(0.8, 1.2)), 1)
                pen.line(pixels, fill=int(random.uniform(0, 70)), width=wide, joint="curve")
    return page


def _ended(stroke: Floats, random: np.random.Generator, most: float) -> Floats:
    """Return a stroke that goes on beyond its ends, or stops before them."""
    result = stroke.copy()
    for end, before in ((0, 1), (-1, -2)):
        ahead = stroke[end] - stroke[before]
        size = float(np.linalg.norm(ahead))
        if size > 0:
            result[end] = stroke[end] + ahead / size * random.uniform(-0.4 * most, most)
    return result


def _shaken(stroke: Floats, random: np.random.Generator, hand: Hand) -> Floats:
    """Return a stroke at another place with slow waves."""
    along = np.arange(len(stroke)) * 0.012
    waves = np.zeros_like(stroke)
    for wavelength in (0.5, 0.22, 0.08):
        phase, size = random.uniform(0, 2 * np.pi, 2), random.normal(0, hand.shake, 2) * (wavelength / 0.22) ** 0.5
        waves += size * np.sin(2 * np.pi * along[:, None] / wavelength + phase)
    return np.asarray(stroke + waves + random.normal(0, hand.shift, 2))


def _broken(stroke: Floats, random: np.random.Generator) -> list[Floats]:
    """Return two pieces of a stroke with a gap between them."""
    if len(stroke) < 6:
        return [stroke]
    at = int(random.integers(2, len(stroke) - 3))
    gap = int(random.integers(1, max(len(stroke) // 6, 1) + 1))
    return [piece for piece in (stroke[:at], stroke[at + gap :]) if len(piece) > 1]
