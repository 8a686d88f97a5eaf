"""The viewer numbers the faces of a file as the service does: face k of the page is triangle k of the run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from meshdeform.assets import load_asset
from tests.browser.viewer.assets import FACES, KINDS, NORMALS, VERTS, Kind, kind
from tests.browser.viewer.site import ViewerSite
from tests.unit.assets.builders import Builder

if TYPE_CHECKING:
    from playwright.sync_api import Page

_OBJ = """o one
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 2 0
v 5 0 0
v 6 0 0
v 6 1 0
v 5 1 0
usemtl red
f 1 2 3 4
f 4 3 5
usemtl blue
f 1 2 3
g part
usemtl red
f 2 3 4 5 1
o two
f 6 7 8 9
f -4 -3 -2 -1
usemtl blue
f 7 8 9
"""


def grouped() -> Kind:
    """An OBJ of several objects, groups and materials, with triangles, quads and a polygon."""
    return kind(_OBJ.encode(), "obj")


def several() -> Kind:
    """Primitives that share vertices with others between them, lines, a hidden node, and a mirrored second instance."""
    builder = Builder()
    shared = builder.primitive(VERTS, FACES, NORMAL=NORMALS)
    half = {"indices": builder.accessor(FACES[: len(FACES) // 2].reshape(-1))}
    lines = {**builder.primitive(VERTS, None), "mode": 1}
    other = builder.primitive(VERTS + [3, 0, 0], FACES[::-1], NORMAL=NORMALS)
    mesh = builder.mesh(shared, lines, other, {**shared, **half})
    child = builder.node(mesh, in_scene=False, translation=[0, 0, 4], scale=[-1, 1, 1])
    builder.node(mesh, children=[child])
    builder.node(mesh, scale=[0, 1, 1])  # flat: left as it is
    builder.node(builder.mesh(other), translation=[0, 5, 0])
    return kind(builder.glb())


def at_rest() -> Kind:
    """A mesh with morph weights of its own, an instance with others, and a hidden node with a child."""
    builder = Builder()
    primitive = builder.primitive(VERTS, FACES, NORMAL=NORMALS)
    primitive["targets"] = [{"POSITION": builder.accessor(np.roll(VERTS, 1, axis=1), bounds=True)}]
    mesh = builder.mesh(primitive, weights=[0.5])
    builder.node(mesh)
    builder.node(mesh, translation=[9, 0, 0], weights=[-0.25])
    child = builder.node(mesh, in_scene=False)
    builder.node(mesh, children=[child], extensions={"KHR_node_visibility": {"visible": False}})
    builder.root["extensionsUsed"] = ["KHR_node_visibility"]
    return kind(builder.glb())


def test_face_by_face_as_the_service_counts(page: Page, site: ViewerSite) -> None:
    for name, make in {**KINDS, "grouped": grouped, "several": several, "at rest": at_rest}.items():
        made = make()
        site.files[name] = made.data
        found: dict[str, Any] = page.evaluate(
            """async ([name, format]) => {
              const viewer = open(name); // closed before it is drawn
              await viewer.load(await fetchBytes(`/files/${name}`), { format });
              const { rest, corners } = numberedSurface(viewer.root);
              closeAll();
              return { rest: [...rest], corners: [...corners] };
            }""",
            [name, made.format],
        )
        asset = load_asset(made.data, f"asset.{made.format}")
        theirs = np.array(found["rest"]).reshape(-1, 3)[np.array(found["corners"]).reshape(-1, 3)]
        ours = asset.surface.positions[asset.surface.triangles]
        assert theirs.shape == ours.shape, name
        # A mirrored instance is wound the other way round, so corners are compared in whatever order they come.
        np.testing.assert_allclose(np.sort(theirs, axis=1), np.sort(ours, axis=1), atol=1e-5, err_msg=name)


def test_an_excluded_node_has_no_numbers(page: Page, site: ViewerSite) -> None:
    made = KINDS["instanced"]()
    site.files["instanced"] = made.data
    asset = load_asset(made.data)
    nodes = [node["index"] for node in asset.pieces().nodes]
    counts: list[int] = page.evaluate(
        """async ([name, nodes]) => {
          const viewer = await show(name);
          return nodes.map((node) => numberedSurface(viewer.root, [node])?.count ?? -1);
        }""",
        ["instanced", nodes],
    )
    assert counts == [len(asset.without([node]).surface.triangles) for node in nodes]


def test_a_ply_of_quads_is_not_numbered(page: Page, site: ViewerSite) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
    for polygon, count in {"3 0 1 2": 1, "4 0 1 2 3": None}.items():
        site.files["quad.ply"] = (head + polygon + "\n").encode()
        found = page.evaluate("async () => numberedSurface((await show('quad.ply', 'ply')).root)?.count ?? null")
        assert found == count
