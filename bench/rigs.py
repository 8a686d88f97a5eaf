"""Measure how well rigged characters animate after their shape has changed: `python bench/rigs.py FOLDER [PICTURE]`.

Every skinned GLB in the folder is made twice as wide at its middle and a little taller by a formula. Its animations are
played with linear-blend skinning, in the source and in results whose rig was kept and has followed. Prints percentiles
of |ln(length of an edge / its length at rest)|, and draws the first animation of each file.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from meshdeform.assets import Asset, load_asset
from meshdeform.geometry.weld import weld
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.runs.surfaces import deformed_surface, vertex_jacobians
from tests.unit.assets.playing import Player

SHOWN = 4
STYLE = RenderStyle(view_size=320, supersample=2, shading="lambert", background=(1.0, 1.0, 1.0))


def fattened(asset: Asset) -> dict[str, bytes]:
    """The source, and the fat character with its rig kept and followed."""
    surface = asset.surface
    welded = weld(surface.positions, surface.triangles)
    verts = welded.mesh.verts
    low, high = verts.amin(0), verts.amax(0)
    middle, size = (low + high) / 2, high - low
    height = (verts[:, 1] - low[1]) / size[1]
    wider = 1 + torch.exp(-(((height - 0.45) / 0.25) ** 2))
    fat = middle + (verts - middle) * torch.stack([wider, torch.ones_like(wider), wider], 1)
    fat[:, 1] += 0.15 * size[1] * torch.sin(height * torch.pi)
    shape = deformed_surface(surface, welded, fat)
    given = shape.positions, shape.normals, shape.tangents
    return {
        "source": asset.to_bytes(),
        "keep": asset.replace(*given),
        "follow": asset.replace(*given, jacobians=vertex_jacobians(welded, fat)),
    }


def skinned(player: Player) -> list[int]:
    return [i for i, node in enumerate(player.root["nodes"]) if "skin" in node and "mesh" in node]


def stretch(player: Player) -> float:
    """The 99th percentile over three times and all skinned meshes."""
    end = max(float(player.read(sampler["input"]).max()) for sampler in player.animation["samplers"])
    found = []
    for node in skinned(player):
        rest = player.at(None, node).lengths
        long = rest > 0.1 * np.median(rest)
        found += [np.abs(np.log(player.at(t, node).lengths[long] / rest[long])) for t in (0.0, end / 3, 2 * end / 3)]
    return float(np.percentile(np.concatenate(found), 99))


def drawn(player: Player) -> Any:
    """The skinned meshes at two thirds of the animation."""
    end = max(float(player.read(sampler["input"]).max()) for sampler in player.animation["samplers"])
    parts = [(player.at(2 * end / 3, node).verts, faces_of(player, node)) for node in skinned(player)]
    starts = np.cumsum([0, *(len(verts) for verts, _ in parts)])
    verts = torch.from_numpy(np.concatenate([verts for verts, _ in parts]))
    faces = torch.from_numpy(np.concatenate([f + s for (_, f), s in zip(parts, starts[:-1], strict=True)]))
    verts = verts - (verts.amin(0) + verts.amax(0)) / 2
    verts = verts / verts.norm(dim=1).max()
    image = Renderer(faces, len(verts), STYLE).render(verts.float(), fixed_cameras(20.0, 10.0, views=1))[0]
    return (image.numpy() * 255).astype(np.uint8)


def faces_of(player: Player, node: int) -> Any:
    primitive = player.root["meshes"][player.root["nodes"][node]["mesh"]]["primitives"][0]
    return player.read(primitive["indices"]).reshape(-1, 3)


def main() -> None:
    """Print the table, and draw the picture if its path is given."""
    rows = []
    print("| asset | animation | source | keep | follow |\n|---|---|---|---|---|")
    for path in sorted(Path(sys.argv[1]).glob("*.glb")):
        asset = load_asset(path.read_bytes(), path.name)
        if not asset.rig().joints or not asset.rig().animations:
            continue
        files = fattened(asset)
        count = asset.rig().animations
        for number in range(0, count, max(1, count // SHOWN)):
            players = [Player(data, number) for data in files.values()]
            shares = " | ".join(f"{stretch(player):.2f}" for player in players)
            print(f"| {path.stem} | {players[0].animation.get('name', number)} | {shares} |", flush=True)
        rows.append(np.concatenate([drawn(Player(data)) for data in files.values()], 1))
    if len(sys.argv) > 2 and rows:
        Image.fromarray(np.concatenate(rows, 0)).save(sys.argv[2])


if __name__ == "__main__":
    main()
