"""Make the pictures of real assets in the docs, of a folder with the files below.

    python -m bench.asset_pictures ASSETS             previews for docs/results.md
    python -m bench.asset_pictures ASSETS CHECKOUT    docs/pictures/keep.webp

Each is run as `meshdeform run` does. In `keep.webp` an asset stands as it is, as another checkout deforms it, such as
one of commit c23ea518, and as this one does. Prints likeness and quality of each.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from bench.jobs import ROOT, deformed
from meshdeform.assets import load_asset
from meshdeform.rendering.studio import Studio, SurfaceState

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


def made(assets: Path, filename: str, prompt: str) -> dict[str, bytes]:
    """Return the artifacts of an asset's job, and print a line."""
    artifacts = deformed((assets / filename).read_bytes(), Path(filename).name, prompt)
    report = json.loads(artifacts["report.json"])
    quality, said = report["quality"], report["verdict"]
    counts = f"flipped {quality['flipped_faces']}, cut {quality['self_intersections_added']}"
    rank = (report.get("likeness") or {}).get("rank")
    print(filename, prompt, report["way"], said["value"], said["reasons"], f"rank {rank}", counts, flush=True)
    return artifacts


def made_before(asset: Path, prompt: str, checkout: Path) -> bytes:
    """Return the GLB that another checkout makes."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "result.glb"
        command = [sys.executable, "-m", "meshdeform", "run", str(asset), prompt, "-o", str(result)]
        subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(checkout)}, cwd=folder)
        return result.read_bytes()


def row(assets: Path, filename: str, prompt: str, checkout: Path) -> Image.Image:
    """Draw an asset, what became of it, and what becomes of it now, each as large as it fits."""
    results = [made_before(assets / filename, prompt, checkout), made(assets, filename, prompt)["result.glb"]]
    source = load_asset((assets / filename).read_bytes(), Path(filename).name)
    azimuths = (FRONTS_DEG.get(filename, 0.0) + 35.0,)
    views = []
    for asset in (source, *(load_asset(each) for each in results)):
        pose = SurfaceState(asset.surface.positions, asset.surface.normals)
        studio = Studio(source.appearance(), (pose,), size=SIDE, azimuths_deg=azimuths)
        views.append(studio.photograph(pose, azimuths)[0])
    image = Image.new("RGB", (3 * SIDE, SIDE + TITLE), "white")
    image.paste(Image.fromarray(np.concatenate(views, axis=1)), (0, TITLE))
    ImageDraw.Draw(image).text((4, 2), f"{prompt}: as it is, before, now", "black", font_size=12)
    return image


def keep(assets: Path, checkout: Path) -> Image.Image:
    """Draw all assets of `KEEP`."""
    rows = [row(assets, *each, checkout) for each in KEEP]
    width, height = rows[0].size
    whole = Image.new("RGB", (COLUMNS * width + GAP, -(-len(rows) // COLUMNS) * height), "white")
    for number, image in enumerate(rows):
        whole.paste(image, (number % COLUMNS * (width + GAP), number // COLUMNS * height))
    return whole


if __name__ == "__main__":
    folder, pictures = Path(sys.argv[1]), ROOT / "docs/pictures"
    if len(sys.argv) > 2:
        keep(folder, Path(sys.argv[2])).save(pictures / "keep.webp", quality=80, method=6)
    else:
        for name, (filename, prompt) in PICTURES.items():
            (pictures / f"{name}.png").write_bytes(made(folder, filename, prompt)["preview.png"])
