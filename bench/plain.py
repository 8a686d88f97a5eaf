"""Measure and draw changes in plain words: ``python -m bench.plain ASSETS FOLDER``.

Makes each of eight changes on each asset that is in the folder, prints a table of what was asked for and got, and
writes a sheet of pictures for each asset. `got` is measured on the vertices that a map was calibrated with, `again`
on the part as it is found anew in the result; `rest` is how far vertices outside of the part moved against each
other, as a share of the diagonal; `cuts` are new self-intersections; `asymmetry` is that of the mirror images that
the source had.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageDraw

from meshdeform.assets import Asset, load_asset
from meshdeform.geometry.congruence import closest_motion
from meshdeform.geometry.quality import measure, measure_structure
from meshdeform.plain.body import Body, body_of
from meshdeform.plain.change import apply_changes
from meshdeform.plain.maps import move
from meshdeform.plain.parts import PartMissingError, Parts
from meshdeform.plain.words import WHOLE, read_changes
from meshdeform.priors.builtin.grammar import noun_of
from meshdeform.rendering.studio import Pose, Studio
from meshdeform.runs.surfaces import TriangleMesh, welded_surface

ROOT = Path(__file__).resolve().parents[1]
CREATURE = [
    "legs longer by 30 %",
    "shorter legs",
    "fatter",
    "thinner",
    "a bigger head",
    "a longer neck",
    "a longer tail",
    "taller",
]
PERSON = ["legs longer by 30 %", "shorter legs", "fatter", "thinner", "a bigger head", "longer arms", "wider", "taller"]
THING = [
    "legs longer by 30 %",
    "shorter legs",
    "thicker legs",
    "taller",
    "wider",
    "flatter",
    "twice as tall",
    "tall and thin",
]
VEHICLE = ["taller", "longer", "wider", "flatter", "bigger wheels", "narrower", "twice as long", "slightly bigger"]
ASSETS = {
    "Husky": CREATURE, "spot": CREATURE, "cow": CREATURE, "Duck": CREATURE, "Dolphin": CREATURE, "Suit": PERSON,
    "RobotExpressive": PERSON, "Chair_1": THING, "Table_RoundLarge": THING, "House_1": VEHICLE, "ambulance": VEHICLE,
    "CommonTree_1": ["taller", "fatter", "thinner", "wider", "twisted", "leaning", "bent", "tapered"],
}  # fmt: skip
SIZE, VIEWS = 250, (35.0, 90.0)


def main() -> None:
    assets, output = map(Path, sys.argv[1:])
    output.mkdir(parents=True, exist_ok=True)
    print("asset            change                asked   got  again  found     rest   flips cuts asymmetry  s")
    for name, words in ASSETS.items():
        path = next((path for path in sorted(assets.rglob(f"{name}.*")) if path.suffix != ".md"), None)
        if path is None:
            print(f"{name}: not in {assets}", file=sys.stderr)
            continue
        asset = load_asset(path.read_bytes(), path.name)
        poses = [("source", asset.surface.positions)]
        for sentence in words:
            made = measured(name, asset, sentence)
            if made is not None:
                poses.append((sentence, made))
        sheet(asset, poses).save(output / f"{name}.png")


def measured(name: str, asset: Asset, sentence: str) -> Any:
    """Make a change, print its line, and return the positions of the surface that viewers show."""
    welded = welded_surface(asset)
    began = time.perf_counter()
    body = body_of(asset, welded.vertex_map, welded.first_rows(), welded.mesh.faces.numpy())
    asked = read_changes(sentence, noun_of)
    assert asked is not None
    try:
        changed, done = apply_changes(body, asked.changes)
    except PartMissingError as error:
        print(f"{name:16.16} {sentence:20.20} refused: {error}", flush=True)
        return None
    seconds = time.perf_counter() - began
    points = (torch.from_numpy(np.ascontiguousarray(each.points)) for each in (body, changed))
    source, result = (TriangleMesh(each, welded.mesh.faces) for each in points)
    structure = measure_structure(source, result).to_dict()
    quality = measure(body.points, body.faces, changed.points).to_dict()
    for each in done:
        print(
            f"{name:16.16} {sentence:20.20} {each.change.factor:6.2f} {each.got:6.2f} "
            f"{again(body, changed, each.change.part):>6}  {each.found_by or '-':10.10}"
            f"{rest(body, changed, each):6.3f} {each.flips:5} {quality['self_intersections_added']!s:>5} "
            f"{structure['asymmetry'] or 0:8.4f} {seconds:5.2f}  {'; '.join(each.warnings)}",
            flush=True,
        )
    positions = asset.surface.positions.copy()
    used = welded.vertex_map >= 0
    positions[used] += (changed.points - body.points)[welded.vertex_map[used]]
    return positions


def again(body: Body, changed: Body, part: str) -> str:
    """Return how much longer a part is when it is looked for anew in the result: no map is made to fit this."""
    lengths = []
    for each in (body, changed):
        parts = Parts(each)
        try:
            if part == "leg":
                lengths.append(parts.legs.hip - each.ground)
            elif part == "head":
                inside = parts.head.weight > 0.9
                lengths.append(float(np.linalg.norm(np.ptp(each.points[inside], axis=0))))
            elif part == "tail":
                lengths.append(parts.tail.length)
        except PartMissingError:
            return "lost"
    return f"{lengths[1] / lengths[0]:.2f}" if len(lengths) == 2 and lengths[0] > 0 else "-"


def rest(body: Body, changed: Body, done: Any) -> float:
    """Return how far what is outside of the part moved against itself, as a share of the diagonal."""
    if done.change.part == WHOLE:
        return 0.0
    outside = np.flatnonzero(move(Parts(body), done.change, 1.0).weight < 0.02)
    if len(outside) < 4:
        return 0.0
    found = closest_motion(body.points[outside], changed.points[outside])
    return float(found.max_distance) / body.diagonal


def sheet(asset: Asset, poses: list[tuple[str, Any]]) -> Image.Image:
    """Draw the source and its changes at one scale, from two sides."""
    look = asset.appearance()
    flat = np.full_like(asset.surface.normals, np.nan)
    states = [Pose(positions, flat) for _, positions in poses]
    studio = Studio(look, states, size=SIZE, azimuths_deg=VIEWS)
    picture = Image.new("RGB", (SIZE * len(poses), 2 * SIZE), "white")
    draw = ImageDraw.Draw(picture)
    for column, ((words, _), state) in enumerate(zip(poses, states, strict=True)):
        for row, view in enumerate(studio.photograph(state, VIEWS)):
            picture.paste(Image.fromarray(view), (column * SIZE, row * SIZE))
        draw.text((column * SIZE + 6, 4), words, fill="black")
    return picture


if __name__ == "__main__":
    main()
