"""The shape is the one that viewers show: morph weights at rest count, and what is hidden does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshdeform.assets import inspect_asset, load_asset
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.assets.export import export
from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_NORMALS, QUAD_VERTS, Builder, notable, unpack
from tests.unit.assets.test_replace import accessor, position

TURN = np.float64([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
DELTAS = np.float32([[0, 0, 1], [0, 0, 2], [1, 0, 0], [0, 1, 0]])
TILT = np.float32([[0.6, 0, -0.2]] * 4)
"""Turns the quad's normals, +Z, towards +X."""


def smiling(*, mesh: list[float] | None = None, node: list[float] | None = None) -> Builder:
    """Return a quad with a target that moves it and turns its normals, under a scaled node."""
    builder = Builder()
    primitive = builder.primitive(NORMAL=QUAD_NORMALS)
    primitive["targets"] = [{"POSITION": builder.accessor(DELTAS, bounds=True), "NORMAL": builder.accessor(TILT)}]
    at = builder.mesh(primitive, **({} if mesh is None else {"weights": mesh}))
    builder.node(at, scale=[2, 2, 2], **({} if node is None else {"weights": node}))
    return builder


@each_case(
    ("mesh", "node", "weight"),
    [(None, None, 0.0), ([0.5], None, 0.5), ([0.5], [1.0], 1.0), ([0.5], [0.0], 0.0), (None, [-0.25], -0.25)],
)
def test_weights_at_rest_are_part_of_the_shape(
    mesh: list[float] | None, node: list[float] | None, weight: float
) -> None:
    surface = load_asset(smiling(mesh=mesh, node=node).glb()).surface
    np.testing.assert_allclose(surface.positions, 2 * (QUAD_VERTS + weight * DELTAS))
    normals = QUAD_NORMALS + weight * TILT
    np.testing.assert_allclose(surface.normals, normals / np.linalg.norm(normals, axis=1, keepdims=True), atol=1e-6)


@each_case("follow", [False, True])
def test_the_result_shows_the_new_shape_with_the_same_weights(follow: bool) -> None:
    asset = load_asset(smiling(node=[0.75]).glb())
    surface = asset.surface
    positions, normals = surface.positions @ TURN.T + 5, surface.normals @ TURN.T
    jacobians = np.broadcast_to(TURN, (4, 3, 3)) if follow else None
    written = asset.replace(positions, normals, jacobians=jacobians)
    root, binary, _ = unpack(written)
    assert root["nodes"][0]["weights"] == [0.75]
    again = load_asset(written).surface
    np.testing.assert_allclose(again.positions, positions, atol=1e-5)
    np.testing.assert_allclose(again.normals, normals, atol=1e-5)
    target = root["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    np.testing.assert_allclose(accessor(root, binary, target), DELTAS @ TURN.T if follow else DELTAS, atol=1e-6)
    still = asset.replace(surface.positions, surface.normals)
    np.testing.assert_array_equal(position(still), QUAD_VERTS)
    np.testing.assert_array_equal(position(still, name="NORMAL"), QUAD_NORMALS)
    # A target that is added goes from the shape that is shown to the new one.
    added = asset.replace(surface.positions * 3, morph=True)
    np.testing.assert_array_equal(position(added), QUAD_VERTS)
    np.testing.assert_allclose(load_asset(added).surface.positions, surface.positions * 3, rtol=1e-6)


def test_instances_of_a_mesh_have_weights_of_their_own() -> None:
    builder = smiling(node=[1.0])
    builder.node(0, weights=[0.0], translation=[9, 0, 0])
    asset = load_asset(builder.glb())
    np.testing.assert_allclose(asset.surface.positions[:4], 2 * (QUAD_VERTS + DELTAS))
    np.testing.assert_allclose(asset.surface.positions[4:], QUAD_VERTS + [9, 0, 0])
    written = asset.replace(asset.surface.positions + 1)
    np.testing.assert_allclose(load_asset(written).surface.positions, asset.surface.positions + 1, atol=1e-5)


def hidden(**visibility: Any) -> Builder:
    """Return a quad, and below a node with these properties two others; the node itself shows nothing."""
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    builder.node(mesh, name="seen")
    hat = builder.node(mesh, in_scene=False, name="hat", translation=[50, 0, 0])
    cape = builder.node(mesh, in_scene=False, name="cape", translation=[0, 50, 0])
    builder.node(name="outfit", children=[hat, cape], extensions={"KHR_node_visibility": visibility})
    builder.root["extensionsUsed"] = ["KHR_node_visibility"]
    return builder


@each_case(("visibility", "shown"), [({"visible": False}, 1), ({"visible": True}, 3), ({}, 3)])
def test_what_a_node_hides_is_not_part_of_the_surface(visibility: dict[str, Any], shown: int) -> None:
    builder = hidden(**visibility)
    asset = load_asset(builder.glb())
    assert asset.summary.triangles == inspect_asset(builder.glb()).triangles == 2 * shown
    names = [warning for warning in notable(asset) if "hides hat, cape" in warning]
    assert len(names) == (shown == 1)
    written = asset.replace(asset.surface.positions + 1)
    root, _, _ = unpack(written)
    assert [node.get("extensions") for node in root["nodes"]] == [
        node.get("extensions") for node in builder.root["nodes"]
    ]
    meshes = [position(written, node["mesh"]) for node in root["nodes"] if "mesh" in node]
    np.testing.assert_array_equal(meshes[0], QUAD_VERTS + 1)
    np.testing.assert_array_equal(meshes[1], QUAD_VERTS + (shown > 1))


def test_an_asset_of_which_nothing_is_shown_is_refused() -> None:
    builder = hidden(visible=False)
    builder.root["scenes"][0]["nodes"] = [3]
    for read in (inspect_asset, load_asset):
        with pytest.raises(AssetEmptyError, match="KHR_node_visibility hides every mesh"):
            read(builder.glb())


FAR = np.float64([478_123.25, 120.5, -5_402_311.75])


def sphere() -> tuple[np.ndarray, np.ndarray]:
    mesh = icosphere(2)
    return np.asarray(mesh.verts, np.float64), np.asarray(mesh.faces)


def obj(verts: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["v {:.9f} {:.9f} {:.9f}".format(*place) for place in verts]
    return "\n".join([*lines, *("f {} {} {}".format(*face) for face in faces + 1), ""]).encode()


def ply(verts: np.ndarray, faces: np.ndarray) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(verts)}\n" + "".join(f"property double {a}\n" for a in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = ["{:.9f} {:.9f} {:.9f}".format(*place) for place in verts]
    return "\n".join([head + rows[0], *rows[1:], *("3 {} {} {}".format(*face) for face in faces), ""]).encode()


@each_case(("name", "write"), [("a.obj", obj), ("a.ply", ply)])
def test_what_is_far_from_the_origin_keeps_its_precision(name: str, write: Any) -> None:
    verts, faces = sphere()
    asset = load_asset(write(verts + FAR, faces), name)
    assert notable(asset) == ()
    np.testing.assert_allclose(asset.surface.positions, verts + FAR, rtol=0, atol=1e-6)
    written = load_asset(asset.replace(asset.surface.positions + [0.25, 0, 0]))
    np.testing.assert_allclose(written.surface.positions, verts + FAR + [0.25, 0, 0], rtol=0, atol=1e-6)
    root, _, _ = unpack(build_glb([Primitive(verts + FAR, faces), Primitive(verts + FAR + 3, faces)]))
    assert root["nodes"][0]["translation"] == root["nodes"][1]["translation"]
    assert np.abs(root["nodes"][0]["translation"] - FAR).max() <= 3.0
    root, _, _ = unpack(build_glb([Primitive(verts, faces), Primitive(verts + 40, faces)]))
    assert not any("translation" in node for node in root["nodes"])
    stl = export(asset, "a.stl")
    origin = stl.facts["origin"]
    assert [float(word) for word in stl.data[:80].split()[4:]] == origin
    again = load_asset(stl.data, "a.stl").surface
    np.testing.assert_allclose(again.positions[again.triangles] + origin, (verts + FAR)[faces], rtol=0, atol=1e-6)
    assert export(load_asset(write(verts, faces), name), "a.stl").facts["origin"] == [0.0, 0.0, 0.0]


@each_case(("distance", "told"), [(0, False), (500, False), (100_000, True), (5_000_000, True)])
def test_positions_that_a_file_has_rounded_are_told(distance: float, told: bool) -> None:
    verts, faces = sphere()
    builder = Builder()
    builder.node(builder.mesh(builder.primitive(verts + [0, 0, distance], faces.astype(np.uint32))))
    warnings = notable(load_asset(builder.glb()))
    assert [("rounds them to steps of" in warning) for warning in warnings] == [True] * told
