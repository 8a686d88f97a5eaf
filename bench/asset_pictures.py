"""Make the pictures of real assets in the docs: ``python -m bench.asset_pictures ASSETS``.

ASSETS is a folder with the files below. Each is run as `meshdeform run` does. The previews of some are those of
docs/results.md; with ``--keep`` there is one picture instead, of all in docs/quality.md, each as it is, pushed by the
builtin model (`sds`), and fitted by shape, which is the default. Prints likeness and quality of each.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from bench.jobs import ROOT, deformed
from meshdeform.assets import load_asset
from meshdeform.rendering.studio import Pose, Studio

PICTURES = {
    "duck_rabbit": ("Duck.glb", "a rabbit"),
    "spot_giraffe": ("spot.obj", "a giraffe"),
    "knight_snowman": ("chr_knight.glb", "a snowman"),
    "truck_boat": ("CesiumMilkTruck.glb", "a boat"),
}
KEEP = (
    ("real/Chair_1.glb", "an armchair"),
    ("real/Table_RoundLarge.glb", "a tall thin table"),
    ("real/House_1.glb", "a church"),
    ("real/ambulance.glb", "a truck"),
    ("real/Husky.glb", "a fat dog"),
    ("real/Dolphin.glb", "a shark with big fins"),
    ("real/Suit.glb", "a fat person"),
    ("real/CommonTree_1.glb", "a mushroom"),
    ("Duck.glb", "a rabbit"),
    ("CesiumMilkTruck.glb", "a car"),
    ("chr_knight.glb", "a snowman"),
    ("spot.obj", "a giraffe"),
    ("cow.obj", "an elephant"),
)
SIDE, TITLE, COLUMNS, GAP = 170, 18, 2, 10
FRONTS_DEG = {"CesiumMilkTruck.glb": 90.0, "spot.obj": 180.0, "cow.obj": 90.0}
"""Where an asset looks, if not along +Z; only the pictures know it."""


def made(assets: Path, filename: str, prompt: str, **params: str) -> dict[str, bytes]:
    """Return the artifacts of an asset's job, and print a line."""
    artifacts = deformed((assets / filename).read_bytes(), Path(filename).name, prompt, **params)
    report = json.loads(artifacts["report.json"])
    quality, said = report["quality"], report["verdict"]
    counts = [quality["flipped_faces"], quality["self_intersections_added"]]
    rank = (report.get("likeness") or {}).get("rank")
    print(filename, prompt, report["way"], said["value"], said["reasons"], f"rank {rank}, flipped, cut {counts}", flush=True)
    return artifacts


def row(assets: Path, filename: str, prompt: str) -> Image.Image:
    """Draw an asset, what a model makes of it, and what its shape is fitted to, each as large as it fits."""
    results = [made(assets, filename, prompt, kind="sds", preset="balanced"), made(assets, filename, prompt)]
    source = load_asset((assets / filename).read_bytes(), Path(filename).name)
    azimuths = (FRONTS_DEG.get(filename, 0.0) + 35.0,)
    views = []
    for asset in (source, *(load_asset(each["result.glb"]) for each in results)):
        pose = Pose(asset.surface.positions, asset.surface.normals)
        studio = Studio(source.appearance(), (pose,), size=SIDE, azimuths_deg=azimuths)
        views.append(studio.photograph(pose, azimuths)[0])
    image = Image.new("RGB", (3 * SIDE, SIDE + TITLE), "white")
    image.paste(Image.fromarray(np.concatenate(views, axis=1)), (0, TITLE))
    ImageDraw.Draw(image).text((4, 2), f"{prompt}: as it is, by a model, by shape", "black", font_size=12)
    return image


def keep(assets: Path) -> Image.Image:
    """Draw all assets of `KEEP`."""
    rows = [row(assets, *each) for each in KEEP]
    width, height = rows[0].size
    whole = Image.new("RGB", (COLUMNS * width + GAP, -(-len(rows) // COLUMNS) * height), "white")
    for number, image in enumerate(rows):
        whole.paste(image, (number % COLUMNS * (width + GAP), number // COLUMNS * height))
    return whole


if __name__ == "__main__":
    folder, pictures = Path(sys.argv[1]), ROOT / "docs/pictures"
    if "--keep" in sys.argv:
        keep(folder).save(pictures / "keep.webp", quality=80, method=6)
    else:
        for name, (filename, prompt) in PICTURES.items():
            (pictures / f"{name}.png").write_bytes(made(folder, filename, prompt)["preview.png"])
