"""Read assets of known nouns and draw their parts: ``python -m bench.parts ASSETS FOLDER``.

ASSETS holds files and `nouns.json`, {"file": noun} or {"file": [noun, azimuth of the front in degrees]}. Writes sheets
of labelled pictures into FOLDER and prints a line for each asset: CPU seconds, front with its margin, residual, the
member, and the confidence of each part. ``python -m bench.parts --members [NOUN ...]`` reads members of the families
whose parts are known instead, and prints which share of their area is right.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image

from bench.label_sheets import picture, sheet
from meshdeform.assets import load_asset
from meshdeform.nouns.families import FAMILIES
from meshdeform.nouns.labels import LabelledMember, labelled_member
from meshdeform.nouns.solids import PART_NAMES
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.evidence import read_body
from meshdeform.priors.builtin.teaching.deformed import Part
from meshdeform.reading import Reading, read_asset
from meshdeform.reading.banks import candidate_member, prepare

_SEED = 4321
"""Of a member that is none of those that are fitted."""


def read_file(path: Path, noun: str, front_deg: float | None) -> tuple[Body, Reading, float]:
    """Return the body of a file, its reading, and the CPU seconds that the reading took."""
    body = loose_body(load_asset(path.read_bytes(), path.name))
    prepare(noun)
    start = time.process_time()
    reading = read_body(body, {noun: 1.0}, front_deg)
    return body, reading, time.process_time() - start


def drawn_reading(body: Body, reading: Reading, title: str) -> Image.Image:
    """Draw an asset with the parts that were found, its front turned to the viewer."""
    names = np.array([*PART_NAMES, "none", "ground"])[reading.labels]
    return picture(body.points @ reading.turn.T, body.faces, names.tolist(), title)


def main(assets: Path, folder: Path) -> None:
    """Read all assets that `nouns.json` names."""
    folder.mkdir(parents=True, exist_ok=True)
    images = []
    for name, asked in json.loads((assets / "nouns.json").read_text()).items():
        noun, front_deg = asked if isinstance(asked, list) else (asked, None)
        body, reading, seconds = read_file(assets / name, noun, front_deg)
        margin = "" if reading.front_margin is None else f" {reading.front_margin:.0%}"
        title = f"{Path(name).stem} {noun} {reading.front_azimuth_deg:.0f}{margin} r{100 * reading.residual:.1f}"
        found = ", ".join(f"{part} {share:.2f}" for part, share in reading.confidence.items())
        print(f"{seconds:5.2f} s  {len(body.faces):6} faces  {title}  {found}", flush=True)
        images.append(drawn_reading(body, reading, title))
    for first in range(0, len(images), 24):
        sheet(images[first : first + 24]).save(folder / f"parts-{first // 24:02}.png")


def right_share(member: LabelledMember, noun: str) -> float:
    """Return the share of the area of a member that is read right, noun and front known."""
    reading = read_asset(Part(member.verts, member.faces), {noun: 1.0}, front_azimuth_deg=0.0)
    a, b, c = member.verts[member.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(areas[reading.labels == member.labels].sum() / areas.sum())


def members(nouns: list[str]) -> None:
    """Read two members of each noun: one of those that are drawn for a reading, and another."""
    shares = []
    for noun in nouns:
        known, other = candidate_member(noun, 0), labelled_member(noun, (), np.random.default_rng(_SEED))
        shares.append((right_share(known, noun), right_share(other, noun)))
        print(f"{noun:12} {shares[-1][0]:7.1%} {shares[-1][1]:7.1%}", flush=True)
    table = np.array(shares)
    print(f"mean {table.mean(0)}, least {table.min(0)}, at least 98 %: {(table >= 0.98).sum(0)} of {len(nouns)}")


if __name__ == "__main__":
    if sys.argv[1] == "--members":
        members(sys.argv[2:] or list(FAMILIES))
    else:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
