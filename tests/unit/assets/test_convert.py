"""OBJ, PLY and STL come in with what they hold, and go out as GLB."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from meshdeform.assets import Limits, Primitive, build_glb, load_asset
from meshdeform.errors import AssetTooLargeError
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, unpack

OBJ = b"""mtllib missing.mtl
o first
v 0 0 0
v 1 0 0
v 0 1 0
v 1 1 0.5
vt 0 0
vt 1 0
vt 0 1
vt 0.25 0.75
usemtl red
f 1/1 2/2 3/3
f 3/3 2/2 4/4
"""
PLY = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float nx
property float ny
property float nz
property uchar red
property uchar green
property uchar blue
element face 1
property list uchar int vertex_indices
end_header
0 0 0 0 0 1 255 0 0
1 0 0 0 0 1 255 0 0
1 1 0 0 0 1 0 255 0
0 1 0 0 0 1 0 0 255
4 0 1 2 3
"""


def stl() -> bytes:
    triangle = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    return bytes(80) + struct.pack("<I", 2) + triangle * 2


def test_obj_vertices_are_split_at_uv_seams_and_not_merged() -> None:
    seam = OBJ.replace(b"f 3/3 2/2 4/4", b"f 3/4 2/2 4/4") + b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 5/1 6/2 7/3\n"
    assert len(load_asset(seam, "mesh.obj").surface.positions) == 8
    with pytest.raises(AssetTooLargeError):
        load_asset(PLY, "a.ply", Limits(max_triangles=1))


def test_a_built_glb_reads_back_and_large_ones_have_wide_indices() -> None:
    glb = build_glb(
        QUAD_VERTS,
        QUAD_FACES,
        normals=QUAD_NORMALS,
        uvs=QUAD_VERTS[:, :2],
        name="quad",
        material="clay",
        base_color=(0.5, 0.25, 0.125, 1.0),
    )
    surface = load_asset(glb).surface
    np.testing.assert_array_equal(surface.positions, QUAD_VERTS)
    np.testing.assert_array_equal(surface.triangles, QUAD_FACES)
    root, _, _ = unpack(glb)
    assert root["materials"][0]["name"] == "clay"
    assert root["nodes"] == [{"name": "quad", "mesh": 0}]
    verts = np.random.default_rng(0).random((70_000, 3))
    faces = np.arange(69_999).reshape(-1, 3)
    root, _, _ = unpack(build_glb([Primitive(verts, faces), Primitive(QUAD_VERTS, QUAD_FACES, material="m")]))
    assert root["accessors"][root["meshes"][0]["primitives"][0]["indices"]]["componentType"] == 5125
    assert root["accessors"][root["meshes"][1]["primitives"][0]["indices"]]["componentType"] == 5123
    assert root["scenes"] == [{"nodes": [0, 1]}]
