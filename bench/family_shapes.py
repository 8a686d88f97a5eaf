"""Draw new shapes of a parametric family, coloured by part: twelve samples, an interpolation, and completions.

    python -m bench.family_shapes chairs docs/pictures/family_shapes.png

The whole job with the default parameters fits the family to 24 members, ten of them labelled. The first two rows are
samples, the third one is an interpolation, and the last one has completions of one part of a member.
"""

from __future__ import annotations

import io
import json
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.family_accuracy import collection_of, fitted
from bench.jobs import artifacts, start
from bench.parametric_families import PARTS, family, packed
from meshdeform.assets import load_asset
from meshdeform.runs.family_results import Shown, family_png

_MEMBERS = 24
_BETWEEN = {"chairs": (0, 1), "airplanes": (0, 2), "bicycles": (0, 2)}
_KEPT = {"chairs": (3, "leg"), "airplanes": (3, "wing"), "bicycles": (1, "wheel")}
"""The members of the interpolation; the member and the part of the completions."""


def made(files: dict[str, tuple[bytes, str]], parts: tuple[str, ...], **params: Any) -> list[Shown]:
    """Run a job of the kind `family_synthesize`, and return its shapes with the part of each triangle."""
    results = artifacts(start({"kind": "family_synthesize", "params": params}, files))
    report = json.loads(results["report.json"])
    found: list[Shown] = []
    with zipfile.ZipFile(io.BytesIO(results["shapes.zip"])) as archive:
        for name, about in zip(sorted(archive.namelist()), report["shapes"], strict=True):
            gaps = ", ".join(f"{each['part']} {each['gap']:.1%}" for each in about["parts"] if each["gap"] > 0.005)
            print(f"{params.get('mode', 'sample'):12} {name}  gaps: {gaps or 'none'}", flush=True)
            asset = load_asset(archive.read(name), name)
            of_triangle = np.zeros(len(asset.surface.triangles), np.uint8)
            for node in asset.parts().nodes:
                of_triangle[asset.parts().in_node(node["index"])] = parts.index(str(node["name"]))
            found.append((asset.surface.positions, asset.surface.triangles, of_triangle))
    return found


def main() -> None:
    name, picture = sys.argv[1:]
    torch.set_num_threads(1)
    parts = PARTS[name]
    members = family(name, _MEMBERS)
    fit = fitted(collection_of(name, _MEMBERS), {})[1]["family.safetensors"]
    files = {
        "family": (fit, "family.safetensors"),
        "collection": (packed(members), "collection.zip"),
    }
    ends = [members[number].name for number in _BETWEEN[name]]
    kept, part = _KEPT[name]
    rows = made(files, parts, count=12)
    rows += made(files, parts, mode="interpolate", members=ends, count=6)
    rows += made(files, parts, mode="complete", members=[members[kept].name], keep=[part], count=6)
    Path(picture).write_bytes(family_png(rows, parts))


if __name__ == "__main__":
    main()
