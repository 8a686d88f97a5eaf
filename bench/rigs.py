"""Play rigged assets before and after: ``python -m bench.rigs FOLDER [--rig keep] [--out OUT] [--names ...]``.

FOLDER has the files of `RIGS`, found by their SHA-256; nothing is fetched. Each gets its prompt with the preset
`balanced`, and every clip of the file is sampled at eight times, in the source and in the result. A file without clips
is turned at each of its bones in turn, by 40 degrees. Reported for each asset:

- folds: the largest share, over all times, of faces whose normal is turned by more than 120 degrees against a
  neighbour's, where the source's at that time is not;
- joints: the largest distance, in percent of the result's diagonal, between a joint or a bone and the place to which
  the 24 nearest of the vertices that mostly follow it take it, by their mean displacement and Jacobian: what the
  change of shape itself asks;
- held: the share of the surface that the safeguard held back in the end.

`--out` gets the results, and a picture of each in the middle of its clips.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from meshdeform.assets import Asset, Limits, load_asset
from meshdeform.assets.accessors import read_floats
from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document
from meshdeform.assets.placement import world_matrices
from meshdeform.geometry.mesh import RestMesh
from meshdeform.priors import load_prior
from meshdeform.rendering.studio import Studio, SurfaceState
from meshdeform.requests.document import JobRequest
from meshdeform.runs import start_run
from meshdeform.runs.base import job_input
from meshdeform.runs.surfaces import vertex_jacobians, welded_surface
from meshdeform.verdicts import read_verdict

SAMPLES, TURN_DEG, MOST_TURNED, MOSTLY, NEAREST = 8, 40.0, 12, 0.5, 24
FOLDED = np.cos(np.deg2rad(120.0))
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Rig:
    """A public asset, and what it is to become."""

    name: str
    repository: str
    path: str
    commit: str
    sha256: str
    prompt: str
    seed: int = 7


ADD_ON = "saturday06/VRM-Addon-for-Blender", "35c84e1401bc3a770eadc4a58da16049ae9bc6fe"
RIGS = (
    Rig(
        "husky",
        "Quaternius",
        "Husky.glb",
        "",
        "b2cb13fa470367cdfa3fb90184f13ccb65f256e009bd4dbc26121f0c541d0cda",
        "a giraffe",
        79887,
    ),
    Rig(
        "fox",
        "KhronosGroup/glTF-Sample-Models",
        "2.0/Fox/glTF-Binary/Fox.glb",
        "657c46491791383a4f6bee9ae56996d2dbba86c5",
        "24b7cd3a9b873a9a9274c1cf95c4108053646c98797750cb31da8b56b0e73c42",
        "a giraffe",
    ),
    Rig(
        "duck",
        "katamini/katamini-dev",
        "public/models/duck.glb",
        "HEAD",
        "b872e50127a2fdb9b94f1ef16a9a66ddf07a3963745e1c98f06354d59b264961",
        "a penguin",
    ),
    Rig(
        "bear",
        "Abhishek-2502/Virtual_Zoo_Website",
        "models/bear.glb",
        "14770701b182b3219e99f3f252ffd219ee02f464",
        "f374829dac4e7160a2bed917f3abd88c33df203030af02e3108a2b01bc620d3f",
        "a fat bear",
    ),
    Rig(
        "vrm 1.0, meshes on bones",
        ADD_ON[0],
        "tests/resources/unity/VrmaInspector/Assets/StreamingAssets/Example.vrm",
        ADD_ON[1],
        "50361cda8094f85ee69ef307a95683efe07c53cbb323aae8d7fac6e7eafb8f7c",
        "a penguin",
    ),
    Rig(
        "vrm 0.x, a head on bones",
        ADD_ON[0],
        "tests/resources/vrm/4.5/out/blend/custom_normal.vrm",
        ADD_ON[1],
        "0b5137acba3cd2dd4b750ae401bed102372b94c9d0a97f3c53b8d32a633b110b",
        "a pig",
    ),
)


def main() -> int:
    """Measure the rigs whose files are in the folder, and print a line of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rig", default="follow", choices=("follow", "keep"))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--names", nargs="*", default=[rig.name for rig in RIGS])
    options = parser.parse_args()
    files = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in options.folder.iterdir() if path.is_file()}
    missing = [rig for rig in RIGS if rig.name in options.names and rig.sha256 not in files]
    for rig in missing:
        print(f"{rig.name}: {rig.repository} {rig.path} is not in {options.folder}", file=sys.stderr)
    for rig in RIGS:
        if rig.name in options.names and rig not in missing:
            source = files[rig.sha256].read_bytes()
            result, report = deformed(rig, source, options.rig)
            print(json.dumps({"name": rig.name, "prompt": rig.prompt, **measured(source, result, report)}), flush=True)
            if options.out is not None:
                save(options.out, rig.name, source, result)
    return 1 if missing else 0


def deformed(rig: Rig, source: bytes, mode: str) -> tuple[bytes, dict[str, Any]]:
    """Return the result of the rig's prompt, and its report."""
    params = {"preset": "balanced", "seed": rig.seed}
    request = JobRequest.model_validate({"prompt": rig.prompt, "params": params, "output": {"rig": mode}})
    prior = load_prior("builtin", device="cpu")
    run = start_run(job_input(source, "asset.glb", request, prior=prior))
    for _ in run:
        pass
    artifacts = run.finish()
    return artifacts["result.glb"].data, json.loads(artifacts["report.json"].data)


def measured(source: bytes, result: bytes, report: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of an asset."""
    before, after = (load_asset(data, "a.glb", Limits.unlimited()) for data in (source, result))
    welded = welded_surface(before)
    rows, faces = welded.first_rows(), welded.mesh.faces
    edges = RestMesh.of(welded.mesh).edges
    neighbours = edges.faces[(edges.faces >= 0).all(1) & edges.consistent]
    folds = []
    for at_source, at_result in zip(moments(before), moments(after), strict=True):
        shapes = (at_source.surface.positions[rows], at_result.surface.positions[rows])
        folded = [_folded(shape, faces, neighbours) for shape in shapes]
        folds.append(float((folded[1] & ~folded[0]).mean()))
    return {
        "moments": len(folds),
        "folds": round(max(folds), 5),
        "joints": round(100 * joint_distance(before, after), 2),
        "held": round(report["movement"]["held_at_end"], 3) if "movement" in report else 0.0,
        "verdict": (read_verdict(report) or {}).get("value"),
    }


def _folded(verts: Floats, faces: NDArray[np.int64], neighbours: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return flags (F,) of the faces that are turned by more than 120 degrees against a neighbour."""
    a, b, c = (verts[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    turned = (normals[neighbours[:, 0]] * normals[neighbours[:, 1]]).sum(1) < FOLDED
    flags = np.zeros(len(faces), bool)
    flags[neighbours[turned].ravel()] = True
    return flags


def joint_distance(before: Asset, after: Asset) -> float:
    """Return how far a joint is, at most, from where the vertices that follow it take it, over the diagonal."""
    rows, owners, shares = before.joint_shares()
    welded, positions, moved = welded_surface(before), before.surface.positions, after.surface.positions
    jacobians = vertex_jacobians(welded, moved[welded.first_rows()])
    worlds = [np.stack(world_matrices(asset._document.root["nodes"]))[:, :3, 3] for asset in (before, after)]
    worst = 0.0
    for joint in np.unique(owners):
        own = rows[(owners == joint) & (shares > MOSTLY)]
        own = own[np.argsort(np.linalg.norm(positions[own] - worlds[0][joint], axis=1))[:NEAREST]]
        if len(own):
            middle, turned = positions[own].mean(0), jacobians[own].mean(0)
            asked = moved[own].mean(0) + turned @ (worlds[0][joint] - middle)
            worst = max(worst, float(np.linalg.norm(worlds[1][joint] - asked)))
    return worst / float(np.linalg.norm(np.ptp(moved, axis=0)))


def moments(asset: Asset) -> Iterator[Asset]:
    """Yield the asset at rest and at the times of its clips, or with each of its bones turned."""
    document: Document = asset._document
    yield asset
    clips = document.root.get("animations", [])
    for clip in clips:
        times = [read_floats(document, sampler["input"])[:, 0] for sampler in clip["samplers"]]
        first, last = min(t[0] for t in times), max(t[-1] for t in times)
        for time in np.linspace(first, last, SAMPLES):
            yield _posed(asset, _sampled(document, clip, float(time)))
    if not clips:
        bones = [at for at, node in enumerate(document.root["nodes"]) if node.get("children") and "mesh" not in node]
        step = max(1, len(bones) // MOST_TURNED)
        for bone in bones[::step]:
            rest = Rotation.from_quat(document.root["nodes"][bone].get("rotation", [0.0, 0.0, 0.0, 1.0]))
            turned = (rest * Rotation.from_euler("x", TURN_DEG, degrees=True)).as_quat().tolist()
            yield _posed(asset, {bone: {"rotation": turned}})


def _posed(asset: Asset, changed: dict[int, dict[str, Any]]) -> Asset:
    """Return the asset with other transforms and weights of its nodes."""
    document = asset._document.fork()
    for node, values in changed.items():
        document.root["nodes"][node] = clone(document.root["nodes"][node]) | values
    return load_asset(document.to_bytes(), "a.glb", Limits.unlimited())


def _sampled(document: Document, clip: Json, time: float) -> dict[int, dict[str, Any]]:
    """Return what a clip gives each node at a time (glTF 2.0, appendix C; cubic splines by their keys alone)."""
    changed: dict[int, dict[str, Any]] = {}
    for channel in clip["channels"]:
        sampler, target = clip["samplers"][channel["sampler"]], channel["target"]
        node, path = target.get("node"), target["path"]
        if node is None or path not in ("translation", "rotation", "scale"):
            continue
        times = read_floats(document, sampler["input"])[:, 0].astype(np.float64)
        values = read_floats(document, sampler["output"]).astype(np.float64)
        if sampler.get("interpolation") == "CUBICSPLINE":
            values = values[1::3]
        at = float(np.clip(time, times[0], times[-1]))
        if sampler.get("interpolation") == "STEP" or len(times) == 1:
            value = values[np.searchsorted(times, at, side="right") - 1]
        elif path == "rotation":
            value = Slerp(times, Rotation.from_quat(values))(at).as_quat()
        else:
            value = np.array([np.interp(at, times, column) for column in values.T])
        changed.setdefault(node, {})[path] = value.tolist()
    return changed


def save(folder: Path, name: str, source: bytes, result: bytes) -> None:
    """Write a result, and a picture of source and result, at rest and at three times."""
    folder.mkdir(parents=True, exist_ok=True)
    slug = name.split(",")[0].replace(" ", "_")
    (folder / f"{slug}.glb").write_bytes(result)
    rows = []
    for data in (source, result):
        asset = load_asset(data, "a.glb", Limits.unlimited())
        shown = list(moments(asset))
        chosen = [shown[at] for at in np.unique(np.linspace(0, len(shown) - 1, 5).astype(int))]
        pictures = []
        for each in chosen:
            pose = SurfaceState(each.surface.positions, each.surface.normals)
            studio = Studio(each.appearance(), (pose,), size=256, azimuths_deg=(35.0,))
            pictures.append(studio.photograph(pose, (35.0,))[0])
        rows.append(np.concatenate(pictures, 1))
    Image.fromarray(np.concatenate(rows)).save(folder / f"{slug}.png")


if __name__ == "__main__":
    sys.exit(main())
