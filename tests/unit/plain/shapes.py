"""A dog of boxes, a chair, and a rig for the dog that walks in place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from tests.unit.assets.builders import Builder
from training.shapes import box

Floats = NDArray[np.float64]
HIP = 1.0


def _box(low: tuple[float, float, float], high: tuple[float, float, float], n: int = 4) -> TriangleMesh:
    size = np.subtract(high, low)
    mesh = box(n, tuple(size.tolist()))
    middle = (mesh.verts.min(0) + mesh.verts.max(0)) / 2
    moved = mesh.verts - middle + np.add(low, high) / 2
    return TriangleMesh(moved, mesh.faces)


def dog() -> dict[str, TriangleMesh]:
    """The parts of a dog that looks along +Z; legs are 1 high."""
    parts = {"trunk": _box((-0.4, HIP, -1.0), (0.4, 1.8, 1.0), 8)}
    for name, x, z in (("FL", 0.3, 0.8), ("FR", -0.3, 0.8), ("BL", 0.3, -0.8), ("BR", -0.3, -0.8)):
        parts[f"Leg_{name}"] = _box((x - 0.1, 0.0, z - 0.1), (x + 0.1, HIP + 0.05, z + 0.1), 6)
    parts["Neck"] = _box((-0.15, 1.6, 0.85), (0.15, 2.3, 1.15), 5)
    parts["Head"] = _box((-0.3, 2.2, 0.8), (0.3, 2.8, 1.6), 5)
    parts["Tail"] = _box((-0.05, 1.6, -1.9), (0.05, 1.7, -0.95), 6)
    return parts


def chair() -> TriangleMesh:
    legs = [_box((x, 0, z), (x + 0.1, 0.5, z + 0.1), 1) for x in (-0.5, 0.4) for z in (-0.5, 0.4)]
    return join(_box((-0.5, 0.5, -0.5), (0.5, 0.6, 0.5), 2), *legs, _box((-0.5, 0.6, -0.5), (0.5, 1.5, -0.4), 3))


def plain_glb(mesh: TriangleMesh, name: str = "", **more: object) -> bytes:
    builder = Builder()
    faces = mesh.faces.astype(np.uint16)
    builder.node(builder.mesh(builder.primitive(mesh.verts, faces)), name=name, **more)
    return builder.glb()


def rigged_dog(*, turned: bool = False) -> bytes:
    """The dog with a joint in each part, below hips at the root, and a walk; `turned`: bound lying, its tail down."""
    builder, parts = Builder(), dog()
    verts, faces, owner, start = [], [], [], 0
    for number, mesh in enumerate(parts.values()):
        verts.append(mesh.verts)
        faces.append(mesh.faces + start)
        owner += [number] * len(mesh.verts)
        start += len(mesh.verts)
    places, joints = np.concatenate(verts), np.zeros((start, 4), np.uint8)
    joints[:, 0] = owner
    weights = np.tile(np.array([1, 0, 0, 0], np.float32), (start, 1))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) if turned else np.eye(3)
    corners = np.concatenate(faces).astype(np.uint16)
    primitive = builder.primitive(places @ turn.T, corners, JOINTS_0=joints, WEIGHTS_0=weights)
    builder.node(builder.mesh(primitive), skin=0)
    at = {name: _joint_place(name, mesh) for name, mesh in parts.items()}
    children = [
        builder.node(in_scene=False, name=name, translation=np.subtract(at[name], at["trunk"]).tolist())
        for name in parts
        if name != "trunk"
    ]
    if turned:  # the pose that viewers show is another one
        builder.root["nodes"][children[-1]] |= {"rotation": [-0.38268343, 0, 0, 0.92387953]}
    root = builder.node(name="Hips", translation=list(at["trunk"]), children=children)
    binds = np.stack([_bind(np.array(at[name]), turn) for name in parts])
    builder.root["skins"] = [{"joints": [root, *children], "inverseBindMatrices": builder.accessor(binds)}]
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    swing = np.array([[0.19866933, 0, 0, 0.98006658], [-0.19866933, 0, 0, 0.98006658]], np.float32)
    bob = np.array([at["trunk"], np.add(at["trunk"], (0, 0.05, 0))], np.float32)
    samplers = [{"input": times, "output": builder.accessor(swing)}, {"input": times, "output": builder.accessor(bob)}]
    channels = [{"sampler": 0, "target": {"node": node, "path": "rotation"}} for node in children[:4]]
    channels.append({"sampler": 1, "target": {"node": root, "path": "translation"}})
    builder.root["animations"] = [{"samplers": samplers, "channels": channels}]
    return builder.glb()


def _joint_place(name: str, mesh: TriangleMesh) -> tuple[float, float, float]:
    low, high = mesh.verts.min(0).tolist(), mesh.verts.max(0).tolist()
    x, z = (low[0] + high[0]) / 2, (low[2] + high[2]) / 2
    if name == "trunk":
        return 0.0, 1.4, 0.0
    if name.startswith("Leg"):
        return x, HIP, z
    return (x, low[1], z) if name != "Tail" else (x, low[1], high[2])


def _bind(place: Floats, turn: Floats) -> NDArray[np.float32]:
    """The matrix from a mesh that lies turned to a joint that stands upright."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn.T
    matrix[:3, 3] = -place
    return np.asarray(matrix.T.reshape(16), np.float32)
