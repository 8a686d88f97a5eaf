"""The contact sheet: a grid where it is full, rows of results where it would be mostly empty."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from PIL import Image

from tests.cases import each_case
from training.evaluation.evaluator import item_folder
from training.evaluation.picture import SIZE
from training.evaluation.sheet import contact_sheet
from training.evaluation.suite import Item

RED, GREEN = (255, 0, 0), (46, 125, 50)


def done(folder: Path, source: str, prompt: str, *, hit: bool) -> dict[str, Any]:
    """Write a red picture as a result, and return its record."""
    place = item_folder(folder, Item(source, prompt, 0))
    place.mkdir(parents=True)
    Image.new("RGB", (SIZE, SIZE), RED).save(place / "steps-000010.png")
    state = {"steps": 10, "judge": {"hit": hit, "retrieved": "a boat"}, "clip": None}
    return {"source": source, "prompt": prompt, "seed": 0, "failed": False, "states": [state]}


def sheet(folder: Path, sources: list[str], records: list[dict[str, Any]]) -> Image.Image:
    prompts = list(dict.fromkeys(record["prompt"] for record in records))
    manifest = {"sources": sources, "prompts": prompts, "seeds": [0]}
    return Image.open(io.BytesIO(contact_sheet(folder, manifest, records))).convert("RGB")


ONE = [("cube", f"a thing {number}") for number in range(30)]
SPARSE = list(zip(("cube", "ball", "vase"), ("a boat", "a car", "a hat"), strict=True))
FULL = [(source, prompt) for source, _ in SPARSE for _, prompt in SPARSE]
GRID = 180 + 3 * 144, 20 + 4 * 144


@each_case(
    ("pairs", "size", "at"),
    [
        (ONE[:3], (4 * 144, 164), (144, 20)),
        (ONE, (12 * 144, 3 * 164), (144, 20)),
        (SPARSE, (6 * 144, 164), (3 * 144, 20)),
        (FULL, GRID, (180, 20 + 144)),
    ],
)
def test_a_full_grid_stays_one_and_others_become_rows(
    pairs: list[tuple[str, str]], size: tuple[int, int], at: tuple[int, int], tmp_path: Path
) -> None:
    """The first result, a hit, stands where it should; the picture is in its frame."""
    folder = tmp_path / str(len(pairs))
    picture = sheet(folder, list(dict(pairs)), [done(folder, *pair, hit=pair == pairs[0]) for pair in pairs])
    assert picture.size == size
    assert picture.getpixel((at[0] + 2, at[1] + 72)) == GREEN
    assert picture.getpixel((at[0] + 72, at[1] + 72)) == RED
