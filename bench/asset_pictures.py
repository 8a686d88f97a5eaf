"""Make the pictures of docs/results.md: ``python -m bench.asset_pictures ASSETS``.

ASSETS is a folder with the files below. Each is run as `meshdeform run` does, and the preview is kept. Prints the
likeness and the quality of each.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from bench.jobs import ROOT, deformed

PICTURES = {
    "duck_rabbit": ("Duck.glb", "a rabbit"),
    "spot_giraffe": ("spot.obj", "a giraffe"),
    "knight_snowman": ("chr_knight.glb", "a snowman"),
    "truck_boat": ("CesiumMilkTruck.glb", "a boat"),
}

if __name__ == "__main__":
    for name, (filename, prompt) in PICTURES.items():
        made = deformed(Path(sys.argv[1], filename).read_bytes(), filename, prompt, preset="balanced")
        (ROOT / "docs/pictures" / f"{name}.png").write_bytes(made["preview.png"])
        report = json.loads(made["report.json"])
        found = report["likeness"]
        print(
            f"{name}: {found['noun']} {found['probability']:.0%}, rank {found['rank']}; {report['quality']}", flush=True
        )
