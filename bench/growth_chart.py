"""Draw how CPU time grows, as an SVG with logarithmic axes, and fit its exponents."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["Series", "draw", "exponent"]

COLUMNS, WIDTH, HEIGHT, LEFT, TOP = 4, 240, 190, 40, 34


@dataclass(frozen=True)
class Series:
    """CPU seconds `y` of something over `x`, given in `unit`."""

    what: str
    unit: str
    x: list[float]
    y: list[float]


def exponent(series: Series) -> float:
    """Return p of the best fit y = c x^p, by least squares of the logarithms."""
    return float(np.polyfit(np.log(series.x), np.log(series.y), 1)[0])


def draw(found: list[Series]) -> str:
    """Return an SVG with a panel for each series: time relative to its first, and the fitted power as a line."""
    rows = math.ceil(len(found) / COLUMNS)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {COLUMNS * WIDTH} {rows * HEIGHT}" '
        f'font-family="sans-serif" font-size="10"><rect width="100%" height="100%" fill="#fff"/>'
    ]
    for i, series in enumerate(found):
        out += _panel(series, i % COLUMNS * WIDTH, i // COLUMNS * HEIGHT)
    return "\n".join([*out, "</svg>"]) + "\n"


def _panel(series: Series, left: int, top: int) -> list[str]:
    wide, tall = WIDTH - LEFT - 14, HEIGHT - TOP - 34
    x, y = np.log(series.x), np.log(np.array(series.y) / series.y[0])
    power, constant = np.polyfit(x, y, 1)
    fitted = power * x + constant
    low, high = min(y.min(), fitted.min(), 0.0), max(y.max(), fitted.max(), math.log(2))

    def across(value: float) -> float:
        return float(left + LEFT + wide * (value - x[0]) / (x[-1] - x[0]))

    def up(value: float) -> float:
        return float(top + TOP + tall * (1 - (value - low) / (high - low)))

    middle = 'text-anchor="middle"'
    out = [
        f'<text x="{left + LEFT}" y="{top + 14}" font-weight="bold">{series.what}</text>',
        f'<text x="{left + LEFT}" y="{top + 27}" fill="#555">grows as the power {power:.2f}</text>',
        f'<rect x="{left + LEFT}" y="{top + TOP}" width="{wide}" height="{tall}" fill="none" stroke="#999"/>',
        f'<text x="{left + LEFT + wide / 2}" y="{top + HEIGHT - 6}" {middle} fill="#555">{series.unit}</text>',
    ]
    for value in series.x:
        out.append(f'<text x="{across(math.log(value)):.1f}" y="{top + TOP + tall + 13}" {middle}>{value:,.0f}</text>')
    factor = 1
    while math.log(factor) <= high:
        level = up(math.log(factor))
        out.append(f'<path d="M{left + LEFT} {level:.1f}h{wide}" stroke="#ddd"/>')
        out.append(f'<text x="{left + LEFT - 4}" y="{level + 3:.1f}" text-anchor="end">{factor}</text>')
        factor *= 2 if high < math.log(10) else 10
    out.append(
        f'<path d="M{across(x[0]):.1f} {up(fitted[0]):.1f}L{across(x[-1]):.1f} {up(fitted[-1]):.1f}" '
        'stroke="#8a8f98" stroke-dasharray="3 2"/>'
    )
    out += [f'<circle cx="{across(a):.1f}" cy="{up(b):.1f}" r="3" fill="#d9622b"/>' for a, b in zip(x, y, strict=True)]
    return out
