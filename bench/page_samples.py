"""Make the samples of the web page, so that none of its views opens empty: ``python -m bench.page_samples``.

Writes to service/web/examples: an animal that walks, a car, a teapot, a robot and a horse; a collection for a family;
a mesh for a word of one's own; a drawing; and copies a field of examples/. All are made by formula, and CC0.
"""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from bench.hero import coat
from bench.jobs import ROOT
from bench.parametric_families import family, labels_document
from meshdeform.assets import Limits, build_glb
from meshdeform.assets.container import Json, dump_json, glb_layout, pack_glb, parse_json
from meshdeform.kinds.sketch.lines import View, line_pictures
from meshdeform.kinds.sketch.shapes import shape
from meshdeform.nouns.labels import LabelledMember, labelled_member
from training.evaluation.relaxed import capsule, relaxed_surface, smooth_union
from training.evaluation.sources import quadruped

FOLDER = ROOT / "service" / "web" / "examples"
CHAIRS, DRAWING_SIDE = 12, 320
LEAVES, GOLDEN_ANGLE = 22, 2.39996
WALKER_CELLS, STRIDE_DEG, NOD_DEG, WALK_S = 11, 24.0, 14.0, 1.2
PALETTE = np.array(
    [
        [0.62, 0.23, 0.12],
        [0.82, 0.62, 0.33],
        [0.12, 0.24, 0.34],
        [0.55, 0.58, 0.6],
        [0.2, 0.36, 0.22],
        [0.7, 0.66, 0.58],
    ]
)
"""Linear colours of the parts of a member, in turn."""
MEMBERS = {"car": 3, "teapot": 1, "robot": 4, "horse": 1}
"""Nouns, and the seeds of the members that are drawn."""

Floats = NDArray[np.float64]


def member(noun: str, seed: int) -> bytes:
    """Return a GLB of a member of a noun, its parts in colours; nothing in the file names them."""
    drawn: LabelledMember = labelled_member(noun, (), np.random.default_rng(seed))
    corners = drawn.faces.ravel()
    numbers = np.repeat(drawn.labels, 3)
    # A vertex that parts share is there once for each: each keeps its colour.
    pairs, faces = np.unique(np.stack([corners, numbers], 1), axis=0, return_inverse=True)
    verts, faces = drawn.verts[pairs[:, 0]], faces.reshape(-1, 3)
    colors = PALETTE[np.searchsorted(np.unique(drawn.labels), pairs[:, 1]) % len(PALETTE)]
    return build_glb(verts, faces, normals=_normals(verts, faces), colors=colors, name=noun)


def walker() -> bytes:
    """Return a GLB of the painted animal on six joints, with the clips Walk and Look around."""
    mesh = quadruped(WALKER_CELLS)
    verts = mesh.verts
    data = build_glb(verts, mesh.faces, normals=_normals(verts, mesh.faces), colors=coat(verts), name="Animal")
    layout = glb_layout(data, Limits())
    assert layout.binary is not None
    rig = _Rig(parse_json(data[layout.json], Limits()), bytearray(data[layout.binary]))
    ends, sides = (("Front", 0.2), ("Hind", -0.2)), (("left", 0.1), ("right", -0.1))
    legs = {f"{end} leg {side}": (x, -0.12, z) for end, z in ends for side, x in sides}
    places = {"Body": (0.0, 0.0, 0.0), **legs, "Head": (0.0, 0.2, 0.36)}
    rig.skin(places, _weights(verts, np.array([*places.values()])))
    turn = np.deg2rad(STRIDE_DEG)
    swing = [0, turn, 0, -turn, 0]
    # Legs across from each other step together.
    steps = {name: (0, swing if name in ("Front leg left", "Hind leg right") else [-x for x in swing]) for name in legs}
    nod = np.deg2rad(NOD_DEG)
    rig.clip("Walk", {**steps, "Head": (0, [0, nod / 3, 0, nod / 3, 0])})
    rig.clip("Look around", {"Head": (1, [0, 2 * nod, 0, -2 * nod, 0])})
    return pack_glb(dump_json(rig.content), [bytes(rig.body)], b"")


def _weights(verts: Floats, joints: Floats) -> Floats:
    """Return how much a vertex follows body, legs and head, (V, 6): a leg below its hip, the head before the neck."""
    shares = np.zeros((len(verts), len(joints)))
    below = np.clip((joints[1, 1] - verts[:, 1]) / 0.16, 0, 1)
    sides = np.abs(verts[:, None, ::2] - joints[None, 1:5, ::2] * [1.6, 1.7])
    shares[np.arange(len(verts)), 1 + np.linalg.norm(sides, axis=2).argmin(1)] = below
    before = np.clip((verts[:, 2] + verts[:, 1] - 0.38) / 0.2, 0, 1) * (1 - below)
    shares[:, 5] = before
    shares[:, 0] = 1 - shares.sum(1)
    return shares


class _Rig:
    """Joints, weights and clips for the one mesh of a GLB."""

    def __init__(self, content: Json, body: bytearray) -> None:
        self.content, self.body = content, body

    def accessor(self, data: NDArray[np.generic], kind: str, code: int, **more: object) -> int:
        self.body += bytes(-len(self.body) % 4)
        views, accessors = self.content["bufferViews"], self.content["accessors"]
        views.append({"buffer": 0, "byteOffset": len(self.body), "byteLength": data.nbytes})
        self.body += data.tobytes()
        self.content["buffers"][0]["byteLength"] = len(self.body)
        about = {"bufferView": len(views) - 1, "componentType": code, "count": len(data), "type": kind}
        accessors.append({**about, **more})
        return len(accessors) - 1

    def skin(self, places: dict[str, tuple[float, float, float]], shares: Floats) -> None:
        """Bind the mesh to joints at places, the first of which carries all others."""
        nodes, attributes = self.content["nodes"], self.content["meshes"][0]["primitives"][0]["attributes"]
        first = len(nodes)
        self.joints = {name: first + k for k, name in enumerate(places)}
        nodes += [{"name": name, "translation": list(place)} for name, place in places.items()]
        nodes[first]["children"] = [*range(first + 1, len(nodes))]
        self.content["scenes"][0]["nodes"].append(first)
        nearest = np.argsort(-shares, axis=1, kind="stable")[:, :4].astype(np.uint8)
        weights = np.take_along_axis(shares, nearest.astype(np.int64), 1).astype(np.float32)
        attributes["JOINTS_0"] = self.accessor(np.where(weights > 0, nearest, 0).astype(np.uint8), "VEC4", 5121)
        attributes["WEIGHTS_0"] = self.accessor(weights / weights.sum(1, keepdims=True), "VEC4", 5126)
        binds = np.tile(np.eye(4, dtype=np.float32), (len(places), 1, 1))
        binds[:, 3, :3] = -np.array([*places.values()])  # columns first
        bound = self.accessor(binds.reshape(-1, 16), "MAT4", 5126)
        self.content["skins"] = [{"joints": [*self.joints.values()], "inverseBindMatrices": bound}]
        next(node for node in nodes if "mesh" in node)["skin"] = 0

    def clip(self, name: str, turns: dict[str, tuple[int, list[float]]]) -> None:
        """Add a clip that turns joints about an axis by angles, in radians, at equal times."""
        times = np.linspace(0, WALK_S, 5).astype(np.float32)
        at = self.accessor(times, "SCALAR", 5126, min=[0.0], max=[float(times[-1])])
        samplers: list[dict[str, int]] = []
        channels: list[dict[str, object]] = []
        for joint, (axis, angles) in turns.items():
            rotation = np.zeros((5, 4), np.float32)
            rotation[:, axis], rotation[:, 3] = np.sin(np.array(angles) / 2), np.cos(np.array(angles) / 2)
            channels.append({"sampler": len(samplers), "target": {"node": self.joints[joint], "path": "rotation"}})
            samplers.append({"input": at, "output": self.accessor(rotation, "VEC4", 5126)})
        self.content.setdefault("animations", []).append({"name": name, "samplers": samplers, "channels": channels})


def chairs() -> bytes:
    """Return a ZIP of labelled chairs, enough for a family."""
    members = family("chairs", CHAIRS)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for each in members:
            archive.writestr(zipfile.ZipInfo(each.name), each.glb(), zipfile.ZIP_DEFLATED)
        labels = json.dumps(labels_document("chairs", members, CHAIRS, classes=False))
        archive.writestr(zipfile.ZipInfo("labels.json"), labels, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def dragonfruit() -> bytes:
    """Return a GLB of a fruit with leaves, which no word of ours names."""
    leaves = []
    for k in range(LEAVES):
        height = 0.9 - 1.7 * (k + 0.5) / LEAVES
        around = np.sqrt(1 - height**2) * 0.5
        x, z = around * np.cos(GOLDEN_ANGLE * k), around * np.sin(GOLDEN_ANGLE * k)
        leaves.append(capsule((x, 0.62 * height, z), (1.4 * x, 0.62 * height + 0.24, 1.4 * z), 0.09, 0.03))
    mesh = relaxed_surface(smooth_union(capsule((0, -0.18, 0), (0, 0.18, 0), 0.46, 0.44), *leaves, blend=0.05), 10)
    far = np.linalg.norm(mesh.verts * [1, 0.75, 1], axis=1)
    green = np.clip((far - 0.5) / 0.16, 0, 1)[:, None]
    colors = (1 - green) * np.array([0.62, 0.04, 0.19]) + green * np.array([0.26, 0.42, 0.08])
    normals = _normals(mesh.verts, mesh.faces)
    return build_glb(mesh.verts, mesh.faces, normals=normals, colors=colors, name="Dragonfruit")


def drawing() -> bytes:
    """Return a PNG of the lines of a chair."""
    chair = shape("chair", {})
    ((_, page),) = line_pictures(chair.verts, chair.faces, chair.labels, [View(25, 16)], DRAWING_SIDE)
    buffer = io.BytesIO()
    lines = Image.fromarray(np.where(page > 0, 0, 255).astype(np.uint8)).filter(ImageFilter.MinFilter(3))
    lines.quantize(16).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _normals(verts: Floats, faces: NDArray[np.int64]) -> Floats:
    return np.asarray(trimesh.Trimesh(verts, faces, process=False).vertex_normals)


SAMPLES: dict[str, Callable[[], bytes]] = {
    "walker.glb": walker,
    "chairs.zip": chairs,
    "dragonfruit.glb": dragonfruit,
    "drawing.png": drawing,
    **{f"{noun}.glb": lambda noun=noun, seed=seed: member(noun, seed) for noun, seed in MEMBERS.items()},  # type: ignore[misc]
}


def main() -> None:
    """Write all samples."""
    for name, make in SAMPLES.items():
        data = make()
        (FOLDER / name).write_bytes(data)
        print(f"{name}: {len(data):,} bytes")
    shutil.copy(ROOT / "examples" / "bumpy_torus.ndf", FOLDER / "bumpy_torus.ndf")


if __name__ == "__main__":
    main()
