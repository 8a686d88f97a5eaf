"""Show that a change of the code changes no result: ``python -m bench.same_results [--write FILE | --against FILE]``.

Runs 20 short requests (prompts, targets, pictures, control) by `meshdeform.runs.start_run` on one thread and prints the
SHA-256 of each `result.glb`. Write them at one commit and compare at another, on the same machine: other processors
round differently. Exit status 1 names the requests whose result differs. ``--names`` runs some of them.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import io
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image, ImageDraw

from meshdeform.priors import load_prior
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.runs.devices import use_threads

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
STEPS = 12


def shed() -> bytes:
    """Return a GLB of four parts that touch: walls, a roof, and two wheels of another material."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((2.0, 1.0, 1.0)), node_name="walls")
    roof = trimesh.creation.cone(0.9, 0.6, sections=24)
    roof.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    scene.add_geometry(roof.apply_translation((0.0, 0.5, 0.0)), node_name="roof")
    for side in (-1.0, 1.0):
        wheel = trimesh.creation.icosphere(subdivisions=2, radius=0.3).apply_translation((0.6 * side, -0.5, 0.5))
        scene.add_geometry(wheel, node_name="left" if side < 0 else "right")
    content = scene.export(file_type="glb")
    assert isinstance(content, bytes)
    return content


def disc() -> bytes:
    """Return a PNG of a white disc on black: the silhouette of something round."""
    picture = Image.new("L", (128, 128))
    ImageDraw.Draw(picture).ellipse((24, 34, 104, 114), fill=255)
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


def requests() -> dict[str, dict[str, Any]]:
    """Return the requests by name: the document's members, and its files under `files`."""
    target = {"guidance": {"kind": "target"}}
    from_vase = {"asset": "sphere.glb", "target": "vase.glb"}
    box = {"box": {"min": [-9, -9, -9], "max": [9, 0, 9]}}
    return {
        "prompt": {"prompt": "a mushroom"},
        "prompt, another seed": {"prompt": "a mushroom", "params": {"seed": 7}},
        "prompt, balanced": {"prompt": "a dog", "params": {"preset": "balanced"}},
        "prompt, paper": {"prompt": "a vase", "params": {"preset": "paper"}},
        "prompt, another source": {"prompt": "a goblet", "files": {"asset": "vase.glb"}},
        "prompt, several parts": {"prompt": "a car", "files": {"asset": "shed"}},
        "prompt, surface": {"prompt": "a car", "params": {"carrier": "surface"}, "files": {"asset": "shed"}},
        "prompt, front found": {
            "prompt": "a cat",
            "params": {"guidance": {"orientation": "auto"}},
            "files": {"asset": "capsule.glb"},
        },
        "prompt, no structure": {"prompt": "a tall vase", "params": {"control": {"keep_structure": False}}},
        "prompt, negative": {
            "prompt": "a chair",
            "params": {"guidance": {"negative_prompt": "a table", "guidance_scale": 5.0}},
        },
        "prompt, safeguard": {"prompt": "a rabbit", "params": {"safeguard": "intersections"}},
        "prompt, subdivided": {
            "prompt": "a house",
            "output": {"subdivide": True, "compact": True},
            "files": {"asset": "cube.glb"},
        },
        "prompts": {
            "params": {"guidance": {"prompts": [{"prompt": "a mushroom"}, {"prompt": "a tall vase", "regions": [box]}]}}
        },
        "target": {"params": target, "files": from_vase},
        "target, points": {
            "params": {"guidance": {**target["guidance"], "point_weight": 1.0, "align": "none"}},
            "files": from_vase,
        },
        "silhouettes": {
            "params": {"guidance": {"kind": "silhouettes", "silhouettes": [{"azimuth": 0}]}},
            "files": {"asset": "sphere.glb", "silhouette_1": "disc"},
        },
        "regions": {
            "prompt": "a mushroom",
            "params": {"control": {"regions": [{**box, "action": "keep"}], "falloff": 0.1}},
        },
        "handles": {
            "prompt": "a mushroom",
            "params": {"control": {"handles": [{"position": [0, 1, 0], "to": [0, 1.5, 0]}]}},
        },
        "rigid": {"prompt": "a car", "params": {"control": {"rigid": [{"node": "left"}]}}, "files": {"asset": "shed"}},
        "symmetry": {"prompt": "a bird", "params": {"control": {"symmetry": "x"}}, "files": {"asset": "capsule.glb"}},
    }


@functools.cache
def content_of(name: str) -> bytes:
    """Return the bytes of a file of the examples, or of one that is made here."""
    made = {"shed": shed, "disc": disc}.get(name)
    return made() if made else (EXAMPLES / name).read_bytes()


def result_of(members: Mapping[str, Any]) -> str:
    """Run a request to its end and return the SHA-256 of `result.glb`."""
    names = members.get("files", {"asset": "sphere.glb"})
    files = {part: InputFile(content_of(name), name if "." in name else f"{name}.glb") for part, name in names.items()}
    document = {name: value for name, value in members.items() if name != "files"}
    document["params"] = {"preset": "preview", "steps": STEPS, **document.get("params", {})}
    run = start_run(RunInput(request=JobRequest.model_validate(document), files=files, load_prior=_prior))
    for _ in run:
        pass
    return hashlib.sha256(run.finish()["result.glb"].data).hexdigest()


@functools.cache
def _prior(model: str) -> Any:
    return load_prior(model, device="cpu")


def main() -> None:
    """Run the requests; print, write or compare the hashes."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="write the hashes to this JSON file")
    parser.add_argument("--against", type=Path, help="compare with the hashes in this file; exit 1 where they differ")
    parser.add_argument("--names", nargs="*", help="only these requests")
    options = parser.parse_args()
    use_threads(1)
    hashes = {}
    for name, members in requests().items():
        if not options.names or name in options.names:
            hashes[name] = result_of(members)
            print(f"{hashes[name][:16]}  {name}", flush=True)
    if options.write:
        options.write.write_text(json.dumps(hashes, indent=2) + "\n")
    if options.against:
        before = json.loads(options.against.read_text())
        different = [name for name, digest in hashes.items() if before.get(name) != digest]
        sys.exit(f"different: {', '.join(different)}" if different else None)


if __name__ == "__main__":
    main()
