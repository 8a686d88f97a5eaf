"""A box in every way that a file can hold one, each with its result: the same box, half as high again in the world."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshdeform.assets import load_asset
from meshdeform.assets.build import build_glb
from tests.unit.assets.builders import Builder
from training.shapes import box

GROWTH = 1.5
_MESH = box(3, (1.0, 1.4, 0.8))
VERTS = _MESH.verts.astype(np.float32)
FACES = _MESH.faces.astype(np.uint16)
NORMALS = (VERTS / np.linalg.norm(VERTS, axis=1, keepdims=True)).astype(np.float32)


@dataclass(frozen=True)
class Kind:
    """A file, the GLB that the project writes for it, and the largest distance in the world that a vertex goes."""

    data: bytes
    format: str
    result: bytes
    displacement: float
    triangles: int


def kind(data: bytes, form: str = "glb") -> Kind:
    """Deform a file with the project's own reader and writer."""
    asset = load_asset(data, f"asset.{form}")
    positions = asset.surface.positions
    result = asset.replace(positions * [1.0, GROWTH, 1.0])
    furthest = (GROWTH - 1) * float(np.abs(positions[:, 1]).max())
    return Kind(data, form, result, furthest, asset.summary.triangles)


def obj() -> Kind:
    lines = [f"v {x} {y} {z}" for x, y, z in VERTS.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES.tolist()]
    return kind("\n".join(lines).encode(), "obj")


def ply() -> Kind:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(VERTS)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(FACES)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z}" for x, y, z in VERTS.tolist()] + [f"3 {a} {b} {c}" for a, b, c in FACES.tolist()]
    return kind((head + "\n".join(rows) + "\n").encode(), "ply")


def stl() -> Kind:
    corners = VERTS[FACES]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *face.reshape(-1).tolist(), 0) for face in corners)
    return kind(bytes(80) + struct.pack("<I", len(FACES)) + body, "stl")


def instanced() -> Kind:
    """One mesh on three nodes: under a parent, mirrored, and stretched."""
    builder = Builder()
    mesh = builder.mesh(builder.primitive(VERTS, FACES, NORMAL=NORMALS))
    child = builder.node(mesh, in_scene=False, translation=[0, 2, 0])
    builder.node(children=[child], rotation=[0, 0.38268343, 0, 0.92387953], scale=[1, 0.5, 1])
    builder.node(mesh, translation=[2, 0, 0], scale=[-1, 1, 1])
    builder.node(mesh, translation=[-2, 0.3, 0], scale=[1, 2, 0.5])
    return kind(builder.glb())


def skinned() -> Kind:
    """A skin whose joint, not whose node, says where the mesh is."""
    builder = Builder()
    joint = builder.node(translation=[0, 3, 0], scale=[1, 2, 1])
    bind = np.eye(4, dtype=np.float32).reshape(1, 16)
    builder.root["skins"] = [{"joints": [joint], "inverseBindMatrices": builder.accessor(bind)}]
    joints = np.zeros((len(VERTS), 4), np.uint8)
    weights = np.tile(np.array([1, 0, 0, 0], np.float32), (len(VERTS), 1))
    primitive = builder.primitive(VERTS, FACES, NORMAL=NORMALS, JOINTS_0=joints, WEIGHTS_0=weights)
    builder.node(builder.mesh(primitive), skin=0, translation=[99, 0, 0])
    return kind(builder.glb())


def quantized() -> Kind:
    """16-bit positions and 8-bit normals, brought to size by the node."""
    builder = Builder()
    scale = float(np.abs(VERTS).max())
    positions = np.zeros((len(VERTS), 4), np.int16)  # padded: rows of attributes begin at multiples of four bytes
    positions[:, :3] = np.round(VERTS / scale * 32767)
    normals = np.zeros((len(VERTS), 4), np.int8)
    normals[:, :3] = np.round(NORMALS * 127)
    made = {
        "POSITION": _padded(builder, positions, bounds=True, normalized=True),
        "NORMAL": _padded(builder, normals, normalized=True),
    }
    builder.node(builder.mesh({"attributes": made, "indices": builder.accessor(FACES.reshape(-1))}), scale=[scale] * 3)
    builder.root |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
    return kind(builder.glb())


def unindexed() -> Kind:
    builder = Builder()
    builder.node(builder.mesh(builder.primitive(VERTS[FACES].reshape(-1, 3), None)))
    return kind(builder.glb())


def strip() -> Kind:
    builder = Builder()
    ribbon = np.array([[x, y, 0.1 * x] for x in range(6) for y in (1.0, 0.0)], np.float32)
    builder.node(builder.mesh({**builder.primitive(ribbon, np.arange(12, dtype=np.uint16)), "mode": 5}))
    return kind(builder.glb())


def draco() -> Kind:
    from tests.unit.assets.test_compressed import draco_asset, draco_stream

    return kind(draco_asset(draco_stream()).glb())


def meshopt() -> Kind:
    from tests.unit.assets.test_compressed import meshopt_asset

    return kind(meshopt_asset().glb())


KINDS = {
    made.__name__: made
    for made in (
        obj, ply, stl, instanced, skinned, quantized, unindexed, strip, draco, meshopt,
    )
}  # fmt: skip


def bent(amount: float = 0.4) -> tuple[bytes, bytes]:
    """A GLB whose upper half goes sideways, `amount` at the top, and its source first."""
    data = build_glb(VERTS, FACES, normals=NORMALS)
    asset = load_asset(data)
    positions = asset.surface.positions
    moved = positions + np.maximum(positions[:, 1:2], 0) / 0.7 * [amount, 0, 0]
    return data, asset.replace(moved)


def rigged() -> tuple[bytes, bytes]:
    """A box on two joints that waves, or steps aside with a bulge, and the same half as high again with its rig."""
    builder = Builder()
    upper = builder.node(in_scene=False, translation=[0, 0.7, 0])
    lower = builder.node(translation=[0, -0.7, 0], children=[upper])
    binds = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    binds[0, 3, 1] = 0.7  # columns first: the lower joint stands at the bottom, the upper one in the middle
    builder.root["skins"] = [{"joints": [lower, upper], "inverseBindMatrices": builder.accessor(binds.reshape(2, 16))}]
    share = np.clip(VERTS[:, 1] + 0.5, 0, 1)
    weights = np.stack([1 - share, share, 0 * share, 0 * share], axis=1)
    attributes = {"NORMAL": NORMALS, "JOINTS_0": np.tile(np.array([0, 1, 0, 0], np.uint8), (len(VERTS), 1))}
    primitive = builder.primitive(VERTS, FACES, **attributes, WEIGHTS_0=weights)
    bulge = (VERTS * [0.5, 0.2, 0.5]).astype(np.float32)
    primitive["targets"] = [{"POSITION": builder.accessor(bulge, bounds=True)}]
    mesh = builder.node(builder.mesh(primitive), skin=0)
    times = builder.accessor(np.array([0, 0.5, 1], np.float32), bounds=True)

    def clip(name: str, **tracks: tuple[int, Any]) -> dict[str, Any]:
        samplers = [{"input": times, "output": builder.accessor(np.array(rows, "<f4"))} for _, rows in tracks.values()]
        targets = [{"node": node, "path": path} for path, (node, _) in tracks.items()]
        return {
            "name": name,
            "samplers": samplers,
            "channels": [{"sampler": i, "target": target} for i, target in enumerate(targets)],
        }

    turned = [[0, 0, 0, 1], [0, 0, 0.5, np.sqrt(0.75)], [0, 0, 0, 1]]
    places = [[0, 0.7, 0], [0.4, 0.9, 0], [0, 0.7, 0]]
    builder.root["animations"] = [
        # Where a skin is shown does not depend on its node.
        clip("Armature|Wave", rotation=(upper, turned), translation=(mesh, places)),
        clip("Armature|Step_aside", translation=(upper, places), weights=(mesh, [[0], [1], [0]])),
    ]
    data = builder.glb()
    asset = load_asset(data)
    positions = asset.surface.positions
    jacobians = np.tile(np.diag([1.0, GROWTH, 1.0]), (len(positions), 1, 1))
    return data, asset.replace(positions * [1.0, GROWTH, 1.0], jacobians=jacobians)


def _padded(builder: Builder, rows: Any, *, bounds: bool = False, **more: Any) -> int:
    """Three components of rows of four."""
    item = {
        "bufferView": builder.view(rows.tobytes(), byteStride=rows.strides[0], target=34962),
        "componentType": {"int8": 5120, "int16": 5122}[str(rows.dtype)],
        "count": len(rows),
        "type": "VEC3",
        **more,
    }
    if bounds:
        item |= {"min": rows[:, :3].min(axis=0).tolist(), "max": rows[:, :3].max(axis=0).tolist()}
    builder.root["accessors"].append(item)
    return len(builder.root["accessors"]) - 1
