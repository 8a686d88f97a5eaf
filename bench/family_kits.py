"""Make labelled families out of public collections of CC0 assets, for `family-fit` and the other benchmarks.

    python -m bench.family_kits collections/ kits/

`collections` has the repositories of `_SOURCES`, each as `owner+name`. its folders get
the assets and `labels.json`, ten labelled and the others held out. The truth is by nodes (what is called a wheel), by
materials (wood and bark), and for chairs by height (legs below the seat, the back above it).
"""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from meshdeform.assets import Asset, load_asset

_KENNEY = "Kenney-CCO+Kenney-CCO.glb"
_KAYKIT = "KayKit-Game-Assets+KayKit-"
_QUATERNIUS = "trebeljahr+quaternius-showcase/public/glb"
_WOODS = ("Wood", "White", "Black")
_SOURCES = {
    "vehicles": {
        _KENNEY: "ambulance:van delivery-flat:truck delivery:truck firetruck:truck garbage-truck:truck suv:van "
        "hatchback-sports:car police:car race-future:race race:race sedan-sports:car sedan:car suv-luxury:van "
        "taxi:car tractor-police:tractor tractor-shovel:tractor tractor:tractor truck-flat:truck truck:truck van:van",
    },
    "chairs": {
        _KENNEY: "chair:side:40:52 chairCushion:side:41:53 chairDesk:swivel:30:41 chairModernCushion:side:41:53 "
        "chairModernFrameCushion:side:41:53 chairRounded:side:37:49 desk_chair:swivel:40:58 "
        "desk_chairArms:swivel:34:50 desk_chairStool:stool:64:100 stoolBar:stool:81:100 stoolBarSquare:stool:87:100 "
        "bench:bench:40:52 benchCushion:bench:41:53",
        f"{_KAYKIT}Furniture-Bits-1.0": "chair_A:side:23:41 chair_B:side:23:41 chair_C:side:23:42 "
        "chair_stool:stool:60:100",
        f"{_KAYKIT}Restaurant-Bits-1.0": "chair_A:side:23:42",
        f"{_QUATERNIUS}/house_interior_pack": "Chair_1:side:34:45 Chair_2:side:36:53 Chair_3:side:36:53 "
        "Chair_4:side:34:45 Stool:stool:90:100",
    },
    "trees": {
        f"{_QUATERNIUS}/nature_pack": " ".join(
            f"{kind}_{number}:{kind}"
            for number in range(1, 6)
            for kind in ("CommonTree", "PineTree", "BirchTree", "Willow")
        )
    },
}
"""By folder: name, sub-class, and for chairs from which to which percent of the height the seat is."""
_PARTS = {"vehicles": ["body", "wheel"], "chairs": ["seat", "back", "leg"], "trees": ["trunk", "crown"]}


def whole(path: Path) -> bytes:
    """Return a GLB; of a glTF file beside its buffer, without its textures."""
    if path.suffix == ".glb":
        return path.read_bytes()
    document = json.loads(path.read_text("utf-8"))
    data = (path.parent / document["buffers"][0].pop("uri")).read_bytes()
    for each in document.get("materials", []):
        each.pop("pbrMetallicRoughness", None)
    for each in ("images", "textures", "samplers"):
        document.pop(each, None)
    text = json.dumps(document).encode()
    chunks = [(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", data + b"\0" * (-len(data) % 4))]
    body = b"".join(struct.pack("<I", len(chunk)) + kind + chunk for kind, chunk in chunks)
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def by_height(asset: Asset, low: str, high: str) -> list[str]:
    """Return the part of each triangle of a chair whose seat is between two percentages of the height."""
    heights = asset.surface.positions[asset.surface.triangles][..., 1]
    place = (heights.mean(1) - heights.min()) / np.ptp(heights)
    return [("leg", "seat", "back")[(p > float(low) / 100) + int(p > float(high) / 100)] for p in place]


def labels(family: str, asset: Asset, about: list[str]) -> dict[str, object]:
    """Return the labels of an asset as `labels.json` has them."""
    if family == "chairs":
        return {"triangles": by_height(asset, *about)}
    if family == "vehicles":
        names = [str(node["name"]) for node in asset.parts().nodes]
        return {"nodes": {name: "wheel" if name.startswith("wheel") else "body" for name in names}}
    names = [str(each["name"]) for each in asset.parts().materials]
    return {"materials": {name: "trunk" if name.startswith(_WOODS) else "crown" for name in names}}


def members(folder: Path, family: str) -> Iterator[tuple[str, list[str], bytes]]:
    """Yield the name of each asset of a family, what `_SOURCES` has about it, and its GLB."""
    for number, (source, listed) in enumerate(_SOURCES[family].items()):
        for name, *about in (each.split(":") for each in listed.split()):
            yield f"{name}_{number}.glb", about, whole(next(folder.glob(f"{source}/**/{name}.gl*")))


def main() -> None:
    collections, kits = map(Path, sys.argv[1:])
    for family, parts in _PARTS.items():
        folder = kits / family
        folder.mkdir(parents=True, exist_ok=True)
        assets = {}
        found = list(members(collections, family))
        labelled = set(np.random.default_rng(0).permutation(len(found))[:10].tolist())
        for number, (name, (kind, *about), data) in enumerate(found):
            (folder / name).write_bytes(data)
            assets[name] = labels(family, load_asset(data, name), about) | {"class": kind}
            if number not in labelled:
                assets[name]["held_out"] = True
        (folder / "labels.json").write_text(json.dumps({"parts": parts, "assets": assets}), "utf-8")
        print(f"{folder}: {len(found)} assets")


if __name__ == "__main__":
    main()
