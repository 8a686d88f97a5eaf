"""`params.control.rigid`: what its selectors select, what they refuse, and a whole run that keeps it."""

from __future__ import annotations

import numpy as np
import pytest

from meshdeform.assets import load_asset
from meshdeform.errors import ParameterError
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.weld import weld
from meshdeform.requests.choices import Rigidity
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.groups import grouped
from meshdeform.requests.selection import RigidParams
from meshdeform.runs.control import WeldedSurface, inspect_parts, select_bodies
from tests.unit.assets.builders import Builder
from tests.unit.deformation.worlds import moved
from training.shapes import box, torus


def cart() -> bytes:
    """A body of two materials; an axle of two wheels in a node that is shown twice; a hub below a group node."""
    builder = Builder()
    builder.root["materials"] = [{"name": "paint"}, {"name": "rubber"}, {"name": "never used"}]
    ball, pair = icosphere(2), join(*(moved(torus(n=12, m=8), 0.5 * x, 0, 0, scale=0.15) for x in (-1, 1)))
    half = len(ball.faces) // 2
    faces = ball.faces.astype(np.uint16)
    upper, lower = ({**builder.primitive(ball.verts, part), "material": 0} for part in (faces[:half], faces[half:]))
    lower["attributes"], lower["material"] = upper["attributes"], 1
    body = builder.mesh(upper, lower, name="hull")
    axle = builder.mesh({**builder.primitive(pair.verts, pair.faces.astype(np.uint16)), "material": 1}, name="axle")
    builder.node(body, name="Body")
    builder.node(axle, translation=[0, -1, 0.5])
    builder.node(axle, translation=[0, -1, -0.5])
    hub = builder.mesh(builder.primitive(0.2 * box(1).verts + [2.0, 0, 0], box(1).faces.astype(np.uint16)))
    builder.node(children=[builder.node(hub, in_scene=False, name="hub")], name="Group")
    return builder.glb()


ASSET = load_asset(cart())
WELDED = weld(ASSET.surface.positions, ASSET.surface.triangles)
SURFACE = WeldedSurface(ASSET, WELDED)


def select(*selectors: dict[str, object]) -> list[tuple[int, Rigidity]]:
    """Return the size and the mode of each body that the selectors give."""
    found = select_bodies([RigidParams.model_validate(item) for item in selectors], SURFACE)
    return sorted((len(body.verts), body.mode) for body in found)


WHEEL, BOX = 96, 8


def test_nodes_materials_and_components_select_bodies() -> None:
    assert select() == []
    # A node without a name has its mesh's; two nodes have this mesh, each with two wheels.
    assert select({"node": "axle"}) == [(WHEEL, "rigid")] * 4
    assert select({"node": 1}) == [(WHEEL, "rigid")] * 2
    assert select({"node": 1, "together": True, "mode": "similarity"}) == [(2 * WHEEL, "similarity")]
    assert select({"node": "Group"}) == select({"node": "hub"}) == select({"component": 5}) == [(BOX, "rigid")]
    lower = select({"material": 1})
    assert [size for size, _ in lower[:4]] == [WHEEL] * 4
    assert 0 < lower[4][0] < icosphere(2).verts.shape[0]
    # Those that share vertices are one.
    both = select({"material": "paint", "mode": "similarity"}, {"material": "rubber"})
    assert both == [(WHEEL, "rigid")] * 4 + [(icosphere(2).verts.shape[0], "rigid")]
    assert select({"node": "hub", "mode": "similarity"}, {"node": 4, "mode": "similarity"}) == [(BOX, "similarity")]


def test_a_whole_rigid_asset_and_rigid_parts_of_a_surface_are_refused() -> None:
    alone = Builder()
    alone.node(alone.mesh(alone.primitive()), name="all")
    asset = load_asset(alone.glb())
    welded = weld(asset.surface.positions, asset.surface.triangles)
    with pytest.raises(ParameterError, match="nothing is left"):
        select_bodies([RigidParams(node="all")], WeldedSurface(asset, welded))
    for params in ({"preset": "paper"}, {"carrier": "surface"}):
        with pytest.raises(ParameterError, match="need the lattice"):
            resolve(DeformParams.model_validate(grouped({**params, "rigid": [{"component": 0}]})))


def test_inspection_proposes_the_wheels_by_their_node_and_its_selectors_select_them() -> None:
    found = inspect_parts(ASSET, resolve(DeformParams.model_validate(grouped({"source_noun": "car"}))))
    assert [item["triangles"] for item in found["components"]] == [320, 192, 192, 192, 192, 12]
    assert found["components"][0]["materials"] == [0, 1]
    wheels = next(item for item in found["proposals"] if item["congruent"])
    assert wheels["components"] == [1, 2, 3, 4]
    assert wheels["round"]
    assert wheels["selectors"] == [{"node": 1}, {"node": 2}]
    assert select(*wheels["selectors"]) == [(WHEEL, "rigid")] * 4
    assert [item["components"] for item in found["proposals"]] == [[1, 2, 3, 4], [0]]
    assert not found["warnings"]


def test_deep_hierarchies_are_listed_and_searched_in_linear_time() -> None:
    """A chain of nodes that all show the mesh: the lines from each to the top would be half a million nodes."""
    builder = Builder()
    mesh = builder.mesh(builder.primitive())
    count = 1000
    for at in range(count):
        builder.node(mesh, in_scene=at == 0, **({"children": [at + 1]} if at + 1 < count else {}))
    parts = load_asset(builder.glb()).pieces()
    assert [part["index"] for part in parts.nodes] == list(range(count))
    for node in (0, 400, count - 1):
        assert parts.in_node(node).sum() == 2 * (count - node)
