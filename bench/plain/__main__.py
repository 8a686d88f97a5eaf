"""Say 150 sentences to twelve assets, and measure what was made: ``python -m bench.plain FOLDER [--draw SHEETS]``.

The files are found in the folder by their hash (`assets.toml` says where they are from), and a row is left out whose
file is not there. Each row of the table has what became of the sentence:

    done       what was wanted was made
    doubtful   something else was made, and the report says so
    other      something else was made, and nothing says so
    refused    with the reason; `right` where that was wanted
    broken     it ended in an exception that is no refusal
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from bench.plain.assets import Listed, Row, connected, listed, rows
from bench.plain.measure import judged, outside
from meshdeform.assets import Asset, load_asset
from meshdeform.errors import MeshdeformError
from meshdeform.rendering.studio import Studio, SurfaceState
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs import text_deform
from meshdeform.runs.base import JobFile, job_input
from meshdeform.runs.changes import asked_changes
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.settings import Settings

SIZE, VIEWS, ACROSS = 200, (35.0, 90.0), 5
_A_LITTLE = 0.1
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Made:
    """What became of a row: the positions (N, 3) that viewers show, None if it was refused."""

    outcome: str
    told: str
    positions: _Floats | None = None


def main() -> None:
    """Print the table and its sums."""
    parser = argparse.ArgumentParser(description="Say sentences in plain words to assets, and measure.")
    parser.add_argument("folder", type=Path, help="where the files are")
    parser.add_argument("--draw", type=Path, metavar="SHEETS", help="a folder for a sheet of pictures of each asset")
    parser.add_argument("--only", default="", help="rows whose asset or sentence has this text")
    given = parser.parse_args()
    counted: Counter[tuple[str, bool]] = Counter()
    began = time.process_time()
    for each in listed(given.folder):
        asset = each.asset()
        pictures = [("source", asset.surface.positions)]
        for row in rows():
            if row.asset != each.name or given.only not in f"{row.asset} {row.sentence}":
                continue
            made = outcome(each, asset, row)
            counted[made.outcome, row.expected] += 1
            print(f"{row.asset:11} {row.sentence:30} {made.outcome:8} {made.told}", flush=True)
            if made.positions is not None:
                pictures.append((f"{row.sentence}: {made.outcome}", made.positions))
        if given.draw is not None and len(pictures) > 1:
            given.draw.mkdir(parents=True, exist_ok=True)
            sheet(asset, pictures).save(given.draw / f"{each.name}.png")
    print(*_sums(counted), f"{time.process_time() - began:.0f} s of one core", sep="\n")


def _sums(counted: Counter[tuple[str, bool]]) -> list[str]:
    names = ("done", "right", "refused", "doubtful", "other", "broken")
    totals = ", ".join(f"{sum(counted[name, expected] for expected in (True, False))} {name}" for name in names)
    expected = sum(count for (_, asked), count in counted.items() if asked)
    return [totals, f"of {expected} that an artist would expect to work, {counted['done', True]} are done"]


def outcome(each: Listed, asset: Asset, row: Row) -> Made:
    """Return what becomes of a sentence, checked and run as the service and the command line do."""
    try:
        request = JobRequest.model_validate({"prompt": row.sentence})
        resolved = TEXT_DEFORM.check(request, Settings(), {"asset": JobFile()})
        assert isinstance(resolved, ResolvedParams)
        if asked_changes(row.sentence, resolved) is None:
            return Made("other", "is read as a prompt")
        artifacts = text_deform.start(job_input(each.data, each.filename, request)).finish()
    except MeshdeformError as refused:
        return Made("refused" if row.wanted else "right", str(refused))
    except Exception as fault:  # one row that breaks must not hide the others
        return Made("broken", repr(fault))
    after = load_asset(artifacts["result.glb"].data, "result.glb").surface.positions
    report = json.loads(artifacts["report.json"].data)
    said = " ".join(report["warnings"])
    doubted = (report.get("verdict") or {}).get("value") == "doubtful"
    if not row.wanted:
        return Made("doubtful" if doubted else "other", f"made all the same. {said}", after)
    everything = [np.ones(len(after), bool)]
    pieces = {
        part: everything if part == "whole" else each.pieces(asset, part)
        for part in {wanted.part for wanted in row.wanted}
    }
    # What the joints of a part hold a little of belongs to neither.
    touched = {part: each.pieces(asset, part, _A_LITTLE) for part in pieces if part != "whole"}
    rest = connected(asset, outside(row.wanted, touched)) if "whole" not in pieces else []
    found = judged(row.wanted, pieces, rest, each.front, asset.surface.positions, after)
    word = "done" if found.made else "doubtful" if doubted else "other"
    return Made(word, f"{found.figures}. {said}" if word != "done" or doubted else found.figures, after)


def sheet(asset: Asset, pictures: list[tuple[str, _Floats]]) -> Image.Image:
    """Draw the source and its changes at one scale, from two sides."""
    flat = np.full_like(asset.surface.normals, np.nan)
    poses = [SurfaceState(positions, flat) for _, positions in pictures]
    studio = Studio(asset.appearance(), poses, size=SIZE, azimuths_deg=VIEWS)
    lines = -(-len(pictures) // ACROSS)
    picture = Image.new("RGB", (2 * SIZE * ACROSS, SIZE * lines), "white")
    draw = ImageDraw.Draw(picture)
    for number, ((words, _), pose) in enumerate(zip(pictures, poses, strict=True)):
        x, y = number % ACROSS * 2 * SIZE, number // ACROSS * SIZE
        for column, view in enumerate(studio.photograph(pose, VIEWS)):
            picture.paste(Image.fromarray(view), (x + column * SIZE, y))
        draw.text((x + 6, y + 4), words, fill="black")
    return picture


if __name__ == "__main__":
    main()
