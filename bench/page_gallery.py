"""Make the examples of the web page: their results, their pictures, and the list that the page reads.

python -m bench.page_gallery              writes service/web/examples/gallery.json, gallery/ID.glb and gallery/ID.webp
python -m bench.page_gallery lamp chair   makes these again
python -m bench.page_gallery --animal     writes service/web/examples/animal.glb, a source of its own
python -m bench.page_gallery --pictures   draws the pictures anew

Sources, results and pictures are CC0: the shapes and their paint are made by formula. Each result records in its
`asset.extras.meshdeform` which request made it, of which file.
"""

from __future__ import annotations

import io
import json
import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from bench.hero import painted_animal
from bench.jobs import ROOT, artifacts, start
from meshdeform.assets import load_asset
from meshdeform.rendering.studio import Studio, SurfaceState
from meshdeform.requests.groups import grouped

FOLDER = ROOT / "service" / "web" / "examples"
LIST = FOLDER / "gallery.json"
OUTPUT = {"compact": True, "provenance": True}
AZIMUTH_DEG, SIDE = 30.0, 320
REPORTED = ("verdict", "likeness", "quality", "texture_stretch", "mesh")
"""Parts of a report that the page shows."""
ANIMAL_CELLS = 15
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class Example:
    """One example: what is deformed, and how."""

    name: str
    asset: str
    label: str
    prompt: str
    seed: int
    params: dict[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return the request, which names its kind: it is the same job on every server."""
        params = grouped({"guidance": "exemplar", "seed": self.seed, **self.params})
        return {"prompt": self.prompt, "params": params, "output": OUTPUT}


EXAMPLES = (
    Example("lamp", "vase.glb", "Painted vase", "a lamp", 0),
    Example("giraffe", "animal.glb", "Painted animal", "a giraffe", 0),
    Example("chair", "cube.glb", "Cube", "a chair", 4),
    Example("mushroom", "sphere.glb", "Sphere", "a mushroom with a big cap", 0),
    Example("house", "cube.glb", "Cube", "a house", 0),
    Example("rabbit", "sphere.glb", "Sphere", "a rabbit with big ears", 5),
    Example(
        "kept-foot",
        "vase.glb",
        "Painted vase, its foot kept",
        "a mushroom",
        0,
        {"regions": [{"box": {"min": [-1, -1, -1], "max": [1, -0.6, 1]}, "action": "keep"}]},
    ),
    Example("walker", "walker.glb", "Animal that walks", "longer legs", 0),
    Example("car", "car.glb", "Car", "30 % longer", 0),
    Example("teapot", "teapot.glb", "Teapot", "longer spout", 0),
    Example("robot", "robot.glb", "Robot", "bigger head", 0),
    Example("horse", "horse.glb", "Horse", "longer neck", 0),
)


def make(example: Example) -> dict[str, Any]:
    """Deform the asset, write result and picture, and return the entry of the list."""
    source = (FOLDER / example.asset).read_bytes()
    document = example.document()
    made = artifacts(start(document, {"asset": (source, example.asset)}))
    result, report = made["result.glb"], json.loads(made["report.json"])
    (FOLDER / "gallery").mkdir(exist_ok=True)
    (FOLDER / "gallery" / f"{example.name}.glb").write_bytes(result)
    (FOLDER / "gallery" / f"{example.name}.webp").write_bytes(picture(source, result))
    shown = {name: report[name] for name in REPORTED if report.get(name)}
    return {
        "id": example.name,
        "asset": example.asset,
        "label": example.label,
        "result": f"gallery/{example.name}.glb",
        "picture": f"gallery/{example.name}.webp",
        "document": document,
        "report": _rounded(shown),
    }


class _OnGround(Studio):
    """A studio whose ground is all white, but for the shadow, or all black."""

    ground = 1.0

    def _backdrop(self, view_proj: Singles, shadow: Singles, ground: float) -> Singles:
        lit = super()._backdrop(view_proj, np.zeros_like(shadow), ground)
        return np.asarray(self.ground * super()._backdrop(view_proj, shadow, ground) / lit, np.float32)


def picture(source: bytes, result: bytes) -> bytes:
    """Return a WebP of source and result side by side, at the same scale, transparent around them."""
    assets = [load_asset(data) for data in (source, result)]
    poses = [SurfaceState(asset.surface.positions, asset.surface.normals) for asset in assets]
    studio = _OnGround(assets[0].appearance(), poses, size=SIDE, azimuths_deg=(AZIMUTH_DEG,))
    drawn = []
    for studio.ground in (1.0, 0.0):
        drawn.append(np.concatenate([studio.photograph(pose, (AZIMUTH_DEG,))[0] for pose in poses], 1) / 255)
    # What the grounds differ by is how much of them is seen.
    alpha = 1 - (drawn[0] - drawn[1]).mean(2, keepdims=True)
    image = np.concatenate([drawn[1] / np.maximum(alpha, 1e-3), alpha], 2)
    buffer = io.BytesIO()
    Image.fromarray(np.rint(255 * image.clip(0, 1)).astype(np.uint8)).save(buffer, "WEBP", quality=82, method=6)
    return buffer.getvalue()


def _rounded(value: Any) -> Any:
    """Return a JSON value with four significant digits."""
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items() if name != "judge"}
    return float(f"{value:.4g}") if isinstance(value, float) else value


def main() -> None:
    """Make the examples of the web page."""
    if sys.argv[1:] == ["--animal"]:
        (FOLDER / "animal.glb").write_bytes(painted_animal(ANIMAL_CELLS))
        return
    if sys.argv[1:] == ["--pictures"]:
        for each in json.loads(LIST.read_text())["examples"]:
            files = [(FOLDER / each[name]).read_bytes() for name in ("asset", "result")]
            (FOLDER / each["picture"]).write_bytes(picture(*files))
        return
    known = {each["id"]: each for each in json.loads(LIST.read_text())["examples"]} if LIST.exists() else {}
    for example in EXAMPLES:
        if not sys.argv[1:] or example.name in sys.argv[1:]:
            known[example.name] = entry = make(example)
            size = (FOLDER / entry["result"]).stat().st_size
            print(f"{example.name}: {size:,} bytes, likeness {entry['report'].get('likeness')}", flush=True)
    entries = [known[example.name] for example in EXAMPLES if example.name in known]
    LIST.write_text(json.dumps({"examples": entries}, indent=1) + "\n")


if __name__ == "__main__":
    main()
