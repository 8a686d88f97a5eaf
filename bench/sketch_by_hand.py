"""Draw figures with a moving pointer, as a hand does, and count what they are taken for.

    python -m bench.sketch_by_hand --sheet by_hand.png
    python -m bench.sketch_by_hand --people drawings/

The strokes are drawn with a pen as wide as that of the page's pad.

The figures of `sketch_figures.txt` are strokes that were put down as people draw such things: no mesh, no view and no
renderer made them, perspective is wrong where people's is, and legs may be single lines. Each is drawn by three hands.
A hand is a point that is pulled along the stroke: it cuts corners, trembles, drifts, runs beyond the ends, and now and
then goes over a line once more; and it draws the whole figure tilted, squeezed, small or away from the middle.

`choices` are those that a figure plainly shows, where its family was the first guess. The figures called `other` are
of no family: what counts there is whether the answer says that it is unsure, or refuses. With `--people`, the drawings
are the strokes of the QuickDraw files of a folder (Google, CC-BY 4.0), as they are.
"""

from __future__ import annotations

import argparse
import io
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from meshdeform.errors import DrawingError
from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.looking import Guess, guess, is_unsure

Stroke = NDArray[np.float64]
_WORDS = {"wine glass": "goblet", "floor lamp": "lamp", **{each: each for each in FAMILIES}}
"""The family of a word of QuickDraw; other words are of none."""
_FIGURES = Path(__file__).with_name("sketch_figures.txt")


@dataclass
class Figure:
    """A figure: the family that it is of or `other`, how it is drawn, the choices that it shows, and its strokes."""

    family: str
    how: str
    shows: dict[str, str]
    strokes: list[Stroke] = field(default_factory=list)


def figures(text: str) -> list[Figure]:
    """Read figures; the text says how they are written."""
    found: list[Figure] = []
    for row in text.splitlines():
        if row.startswith("#"):
            continue
        if not row.startswith(" "):
            family, _, rest = row.partition(": ")
            how, _, shows = rest.partition("; ")
            found.append(Figure(family, how, dict(each.split() for each in shows.split(", ") if each)))
            continue
        both, name, *places = row.split() if row.startswith("  both ") else ["", *row.split()]
        stroke = _STROKES[name](np.array([[float(each) for each in place.split(",")] for place in places]))
        found[-1].strokes.append(stroke)
        if both:
            found[-1].strokes.append(stroke * [-1, 1] + [100, 0])
    return found


def people(folder: Path) -> Iterator[Figure]:
    """Yield the drawings of the QuickDraw files of a folder; the longer side is 80 hundredths of the page."""
    for path in sorted(folder.glob("*.ndjson")):
        for row in path.read_text(encoding="utf-8").splitlines():
            drawing = json.loads(row)
            strokes = [np.array(each[:2]).T for each in drawing["drawing"] if len(each[0]) > 1]
            low, high = (limit(np.concatenate(strokes), axis=0) for limit in (np.min, np.max))
            strokes = [50 + 80 * (each - (low + high) / 2) / (high - low).max() for each in strokes]
            yield Figure(_WORDS.get(drawing["word"], "other"), drawing["word"], {}, strokes)


def curve(places: Stroke) -> Stroke:
    """Return a smooth stroke through the places (Catmull-Rom)."""
    p = np.concatenate([places[:1], places, places[-1:]])
    t = np.linspace(0, 1, 9)[:-1, None]
    pieces = [
        0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
        for a, b, c, d in zip(p, p[1:], p[2:], p[3:], strict=False)
    ]
    return np.concatenate([*pieces, p[-1:]])


def oval(places: Stroke) -> Stroke:
    """Return an ellipse, or a part of it; 0.25 is the lowest point."""
    middle, radii, *part = places
    turn = np.linspace(*(part[0] if part else (0.0, 1.0)), 33)[:, None] * 2 * np.pi
    return middle + radii * np.concatenate([np.cos(turn), np.sin(turn)], 1)


def box(places: Stroke) -> Stroke:
    """Return a rectangle in one stroke."""
    (left, top), (right, low) = places
    return np.array([(left, top), (right, top), (right, low), (left, low), (left, top)])


_STROKES = {"line": lambda places: places, "curve": curve, "oval": oval, "box": box}


@dataclass(frozen=True)
class Moves:
    """How a hand moves. Lengths are hundredths of the page; `lag` is the share of the way to the goal at each move."""

    name: str
    lag: float
    tremble: float
    drift: float
    beyond: float
    again: float
    tilt_deg: float
    squeeze: float


HANDS = (
    Moves("steady", 0.75, 0.05, 0.3, 0.8, 0.0, 1.5, 0.03),
    Moves("quick", 0.5, 0.15, 0.8, 2.0, 0.15, 4.0, 0.08),
    Moves("clumsy", 0.4, 0.35, 1.5, 3.0, 0.3, 7.0, 0.15),
)

_PERSON = Moves("person", 1.0, 0, 0, 0, 0, 0, 0)


def moved(stroke: Stroke, hand: Moves, random: np.random.Generator, step: float = 2.0) -> Stroke:
    """Return where the pointer is while it is drawn along a stroke (N, 2)."""
    ahead = stroke[-1] - stroke[-2]
    end = stroke[-1] + ahead / max(np.linalg.norm(ahead), 1e-9) * random.uniform(-0.3, 1.0) * hand.beyond
    path = np.concatenate([stroke, end[None]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    goals = np.linspace(0, along[-1], max(int(along[-1] / step), 3) + 1)
    goals = np.stack([np.interp(goals, along, path[:, i]) for i in (0, 1)], 1)
    goals = np.concatenate([goals, goals[-1:].repeat(3, 0)])  # the hand arrives later than its goal
    drift, here, found = random.normal(0, hand.drift / 2, 2), goals[0].copy(), []
    for goal in goals:
        drift = 0.9 * drift + random.normal(0, hand.drift * 0.3, 2)
        here = here + hand.lag * (goal + drift - here)
        found.append(here + random.normal(0, hand.tremble, 2))
    return np.array(found)


def drawn(strokes: list[Stroke], hand: Moves, random: np.random.Generator) -> list[Stroke]:
    """Return the pointer's strokes for a whole figure."""
    angle = np.deg2rad(random.normal(0, hand.tilt_deg / 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    size = random.uniform(0.6, 0.95) * np.exp(random.normal(0, hand.squeeze / 2, 2))
    size = size / max(1.0, float(size.max()))
    room = 48 * (1 - size)
    matrix, middle = turn * size[None], 50 + random.uniform(-1, 1, 2) * room * 0.7
    made = []
    for stroke in strokes:
        placed = (stroke - 50) @ matrix.T + middle
        for _ in range(2 if random.random() < hand.again else 1):
            made.append(np.clip(moved(placed, hand, random), 1, 99))
    return made


def asked(strokes: list[Stroke]) -> tuple[list[Guess], Image.Image]:
    """Draw with a pen as wide as that of the page's pad, and ask the network."""
    picture = Image.new("L", (512, 512), 255)
    pen = ImageDraw.Draw(picture)
    for stroke in strokes:
        pen.line([(x, y) for x, y in (stroke * 5.12).tolist()], fill=0, width=4, joint="curve")
    buffer = io.BytesIO()
    picture.save(buffer, "PNG")
    try:
        found = guess(buffer.getvalue())
    except DrawingError:
        return [], picture
    return found, picture


def sheet(pictures: list[Image.Image], titles: list[str], columns: int = 9) -> Image.Image:
    """Return all drawings with what they were taken for."""
    cell = 132
    page = Image.new("L", (columns * cell, -(-len(pictures) // columns) * (cell + 16)), 255)
    pen = ImageDraw.Draw(page)
    for number, (picture, title) in enumerate(zip(pictures, titles, strict=True)):
        x, y = number % columns * cell, number // columns * (cell + 16)
        page.paste(picture.convert("L").resize((128, 128)), (x + 2, y))
        pen.rectangle((x + 2, y, x + 130, y + 128), outline=200)
        pen.text((x + 4, y + 130), title, fill=0)
    return page


class Count:
    """Return the families that the drawings were taken for, by family and by hand."""

    def __init__(self) -> None:
        self.right: dict[str, list[tuple[bool, bool]]] = defaultdict(list)
        self.choices: dict[str, list[bool]] = defaultdict(list)
        self.told: list[bool] = []
        self.doubted: list[bool] = []

    def add(self, figure: Figure, hand: Moves, guesses: list[Guess]) -> str:
        """Count one answer, which is empty if the drawing was refused, and return it in words."""
        names = [each.family for each in guesses]
        said = f"{names[0]} {guesses[0].probability:.0%}" if names else "refused"
        unsure = not guesses or is_unsure(guesses)
        (self.told if figure.family == "other" else self.doubted).append(unsure)
        if figure.family == "other":
            return said + (" unsure" if guesses and unsure else "")
        first = names[:1] == [figure.family]
        values = guesses[0].values if first else {}
        wrong = [f"{name} {values[name]}" for name, shown in figure.shows.items() if first and values[name] != shown]
        for group in (figure.family, hand.name, "all"):
            self.right[group].append((first, figure.family in names))
            if first:
                self.choices[group] += [values[name] == shown for name, shown in figure.shows.items()]
        if not first or wrong:
            print(f"{figure.family} {figure.how}, {hand.name}: {said} {', '.join(wrong)}", flush=True)
        return ("" if first else "! ") + said

    def show(self) -> None:
        """Print all shares."""
        for group, results in self.right.items():
            first, three = np.mean(results, axis=0)
            shown = self.choices[group]
            print(f"{group:10} {len(results):3} drawings  first {first:.1%}  first three {three:.1%}", end="  ")
            print(f"choices {np.mean(shown):.1%} of {len(shown)}" if shown else "")
        if self.doubted:
            print(f"ours       {len(self.doubted):3} drawings  called unsure or refused {np.mean(self.doubted):.1%}")
        if self.told:
            print(f"other      {len(self.told):3} drawings  called unsure or refused {np.mean(self.told):.1%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--people", type=Path, help="take the drawings of this folder of QuickDraw files")
    parser.add_argument("--sheet", type=Path, help="write all drawings with what they were taken for")
    options = parser.parse_args()
    count = Count()
    pictures, titles = [], []
    if options.people:
        for figure in people(options.people):
            answer, picture = asked(figure.strokes)
            titles.append(count.add(figure, _PERSON, answer))
            pictures.append(picture)
    for number, figure in enumerate([] if options.people else figures(_FIGURES.read_text("utf-8"))):
        for index, hand in enumerate(HANDS):
            answer, picture = asked(drawn(figure.strokes, hand, np.random.default_rng([31, number, index])))
            titles.append(count.add(figure, hand, answer))
            pictures.append(picture)
    count.show()
    if options.sheet:
        sheet(pictures, titles).save(options.sheet)


if __name__ == "__main__":
    main()
