"""Draw what `bench/surface_pareto.py` measured as an SVG, and print its tables."""

from __future__ import annotations

import math
from typing import Any

__all__ = ["draw", "front", "table"]

Row = dict[str, Any]
COLOURS = {
    "ndf": "#d9622b",
    "decimated": "#8a8f98",
    "Draco": "#2b6fb3",
    "meshopt": "#3b9a5f",
    "marching cubes": "#8d5fb0",
}
TASKS = {"eigenvalues": "first 20 eigenvalues", "geodesics": "geodesic distances"}
WIDTH, HEIGHT, LEFT, TOP, ROWS_TOP = 310, 210, 46, 26, 34
Y = (-4.0, -0.5)
"""Range of the relative error, as powers of ten."""
AXES: dict[str, tuple[tuple[float, float], tuple[tuple[int, str], ...], str]] = {
    "bytes": ((3.0, 6.2), ((3, "1 kB"), (4, "10 kB"), (5, "100 kB"), (6, "1 MB")), "bytes"),
    "seconds": ((-2.0, 0.8), ((-2, "10 ms"), (-1, "100 ms"), (0, "1 s")), "CPU seconds to unpack, prepare and solve"),
}
"""What may go across: the range as powers of ten, marks, and words."""


def good(rows: list[Row], surface: str) -> list[Row]:
    """Return the rows of a surface that have figures, with the seconds of the whole way."""
    parts = ("unpack_s", "prepare_s", "solve_s")
    found = [row for row in rows if row["surface"] == surface and "fails" not in row]
    return [row | {"seconds": sum(row[part] for part in parts)} for row in found]


def front(rows: list[Row], *measures: str) -> list[Row]:
    """Return the rows that no other row beats: none is as good in all measures, and better in one."""

    def beats(one: Row, other: Row) -> bool:
        pairs = [(one[name], other[name]) for name in measures]
        return all(a <= b for a, b in pairs) and any(a < b for a, b in pairs)

    return [row for row in rows if not any(beats(other, row) for other in rows)]


def surfaces(rows: list[Row]) -> list[str]:
    """Return the names of the surfaces in their order."""
    return list(dict.fromkeys(row["surface"] for row in rows))


def draw(rows: list[Row], across: str = "bytes") -> str:
    """Return an SVG: for each surface the errors of both tasks over the bytes or the seconds, with the front."""
    names = surfaces(rows)
    columns = min(3, len(names))
    lines = math.ceil(len(names) / columns)
    width, height = columns * WIDTH + 12, ROWS_TOP + 2 * lines * HEIGHT
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
        f'font-size="10"><rect width="{width}" height="{height}" fill="#fff"/>'
    ]
    at = 12.0
    for method, colour in COLOURS.items():
        out.append(f'<circle cx="{at}" cy="16" r="4" fill="{colour}"/><text x="{at + 8}" y="20">{method}</text>')
        at += 28 + 7 * len(method)
    out.append(f'<text x="{at}" y="20">line: the front. Across: {AXES[across][2]}. Up: mean relative error.</text>')
    for part, (task, words) in enumerate(TASKS.items()):
        for i, name in enumerate(names):
            x, y = i % columns * WIDTH, ROWS_TOP + (part * lines + i // columns) * HEIGHT
            out += _panel(good(rows, name), task, across, f"{name}: {words}", (x, y))
    return "\n".join([*out, "</svg>"]) + "\n"


def _panel(rows: list[Row], task: str, measure: str, title: str, corner: tuple[int, int]) -> list[str]:
    inner, tall = WIDTH - LEFT - 8, HEIGHT - TOP - 30
    (low, high), marks, _ = AXES[measure]
    x, y = corner

    def place(row: Row) -> tuple[float, float]:
        across = (math.log10(row[measure]) - low) / (high - low)
        up = (math.log10(max(row[task], 10 ** Y[0])) - Y[0]) / (Y[1] - Y[0])
        return x + LEFT + inner * min(max(across, 0), 1), y + TOP + tall * (1 - min(max(up, 0), 1))

    out = [f'<text x="{x + LEFT}" y="{y + 16}" font-weight="bold">{title}</text>']
    out.append(f'<rect x="{x + LEFT}" y="{y + TOP}" width="{inner}" height="{tall}" fill="none" stroke="#999"/>')
    for power, label in marks:
        where = x + LEFT + inner * (power - low) / (high - low)
        out.append(f'<path d="M{where:.1f} {y + TOP}v{tall}" stroke="#ddd"/>')
        out.append(f'<text x="{where:.1f}" y="{y + TOP + tall + 13}" text-anchor="middle">{label}</text>')
    for power, label in ((-4, "0.01 %"), (-3, "0.1 %"), (-2, "1 %"), (-1, "10 %")):
        level = y + TOP + tall * (1 - (power - Y[0]) / (Y[1] - Y[0]))
        out.append(f'<path d="M{x + LEFT} {level:.1f}h{inner}" stroke="#ddd"/>')
        out.append(f'<text x="{x + LEFT - 4}" y="{level + 3:.1f}" text-anchor="end">{label}</text>')
    best = sorted((place(row) for row in front(rows, measure, task)), key=lambda p: p[0])
    steps = " ".join(f"H{ax:.1f}V{ay:.1f}" if i else f"M{ax:.1f} {ay:.1f}" for i, (ax, ay) in enumerate(best))
    out.append(f'<path d="{steps}" fill="none" stroke="#444" stroke-dasharray="3 2"/>')
    for row in rows:
        ax, ay = place(row)
        out.append(
            f'<circle cx="{ax:.1f}" cy="{ay:.1f}" r="{4 if row["method"] == "ndf" else 3}" '
            f'fill="{COLOURS[row["method"]]}"><title>{row["method"]}, {row["setting"]}: {row["bytes"]} bytes, '
            f"{row['seconds']:.3f} s, {row[task]:.3%}</title></circle>"
        )
    return out


def table(rows: list[Row]) -> str:
    """Return three tables in Markdown: the fields, the fronts, and Draco's bytes for the error of a field."""
    out = ["| surface | field | bytes | distance | eigenvalues | geodesics |", "|---|---|---|---|---|---|"]
    out += [
        f"| {row['surface']} | {row['setting']} | {row['bytes']:,} | {row['distance']:.3%} | {row['eigenvalues']:.2%} "
        f"| {row['geodesics']:.2%} |"
        for name in surfaces(rows)
        for row in good(rows, name)
        if row["method"] == "ndf"
    ]
    pairs = [(measure, task) for measure in AXES for task in TASKS]
    out += ["", f"| surface | {' | '.join(f'{measure} and {task}' for measure, task in pairs)} |", "|---" * 5 + "|"]
    for name in surfaces(rows):
        found = good(rows, name)
        whole = sum(r["method"] == "ndf" for r in found)
        cells = [f"{sum(r['method'] == 'ndf' for r in front(found, *pair))} of {whole}" for pair in pairs]
        out.append(f"| {name} | {' | '.join(cells)} |")
    out += [
        "",
        "| Draco's bytes for the same error, as a multiple of the field's | distance | eigenvalues | geodesics |",
    ]
    out.append("|---" * 4 + "|")
    for name in surfaces(rows):
        found = good(rows, name)
        for field in (row for row in found if row["method"] == "ndf"):
            sizes = [
                min((r["bytes"] for r in found if r["method"] == "Draco" and r[by] <= field[by]), default=None)
                for by in ("distance", *TASKS)
            ]
            cells = ["-" if size is None else f"{size / field['bytes']:.2f}" for size in sizes]
            out.append(f"| {name}, {field['setting']} | {' | '.join(cells)} |")
    return "\n".join(out)
