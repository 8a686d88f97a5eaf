"""Whole jobs on a tower whose coarse walls meet fine ones: whatever changes it, no corner opens."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.asset import Asset
from meshdeform.geometry.junctions import border_contacts
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.weld import weld
from meshdeform.runs.strength import edit_of, with_edit, with_strength
from tests.cases import each_case
from tests.unit.runs.jobs import finished, started
from training.shapes import grid

Floats = NDArray[np.float64]


def tower() -> bytes:
    """Four walls around nothing, of 2 triangles and of 128 in turn, 3 high: seven vertices lie on each corner."""
    walls = []
    for turn in range(4):
        wall = grid(1 if turn % 2 else 8, 1.0)
        upright = np.stack([wall.verts[:, 0], 3 * wall.verts[:, 1] + 1.5, np.full_like(wall.verts[:, 0], 0.5)], 1)
        quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]], np.float64)
        walls.append(TriangleMesh(upright @ np.linalg.matrix_power(quarter, turn), wall.faces))
    mesh = join(*walls)
    return build_glb(mesh.verts, mesh.faces)


TOWER = tower()
SOURCE = load_asset(TOWER)


def gap(result: bytes | Asset) -> float:
    """The greatest distance of a vertex from the edge on which it lay, in the file of a result."""
    before, after = SOURCE.surface, load_asset(result).surface if isinstance(result, bytes) else result.surface
    welded = weld(before.positions, before.triangles)
    verts, ends = border_contacts(welded.mesh.verts, welded.mesh.faces)
    assert len(np.unique(verts)) == 28
    points = welded.gather(after.positions).verts
    line, arm = points[ends[:, 1]] - points[ends[:, 0]], points[verts] - points[ends[:, 0]]
    share = np.clip((arm * line).sum(1) / (line**2).sum(1), 0, 1)[:, None]
    return float(np.linalg.norm(arm - share * line, axis=1).max())


def bulged() -> bytes:
    """A target that no straight corner fits."""
    ball = icosphere(3)
    return build_glb(ball.verts * [1.2, 1.8, 1.2] + [0.0, 1.5, 0.0], ball.faces)


@each_case(
    "prompt, params",
    [
        ("", {"guidance": "target", "steps": 12, "target": bulged()}),
        ("", {"guidance": "target", "steps": 12, "target": bulged(), "carrier": "lattice"}),
        ("", {"guidance": "target", "steps": 12, "target": bulged(), "safeguard": "intersections"}),
        ("an egg", {"steps": 4, "carrier": "lattice"}),
        ("an egg", {"steps": 4, "regions": [{"box": {"min": [-9, -9, -9], "max": [9, 1.6, 9]}, "action": "keep"}]}),
        ("twisted", {}),
        ("bent", {}),
    ],
)
def test_no_corner_opens_and_the_report_says_so(prompt: str, params: dict[str, Any]) -> None:
    result, report = finished(started(TOWER, prompt, **params))
    moved = np.abs(load_asset(result).surface.positions - SOURCE.surface.positions).max()
    assert moved > 0.005
    assert gap(result) < 1e-6
    assert report["quality"]["opened_junctions"] == 0
    assert not any("Cracks" in sentence for sentence in report["warnings"])


def test_kept_vertices_keep_the_edges_on_which_they_lie() -> None:
    around = {"box": {"min": [-9, 1.4, -9], "max": [9, 1.9, 9]}, "action": "keep"}
    result, report = finished(started(TOWER, "", guidance="target", steps=4, target=bulged(), regions=[around]))
    assert report["regions"]["max_moved"] == 0.0
    assert report["regions"]["kept_vertices"] == 2 * 2 * 9 + 8  # two rows of two walls, and the ends of four corners
    assert gap(result) < 1e-6


def twisted(points: Floats) -> Floats:
    angle = points[:, 1] / 3
    turned = np.stack([np.cos(angle), np.sin(angle)], 1)
    x, z = points[:, 0], points[:, 2]
    return np.stack([turned[:, 0] * x - turned[:, 1] * z, points[:, 1], turned[:, 1] * x + turned[:, 0] * z], 1)


def test_strengths_and_shapes_from_other_files_leave_it_closed() -> None:
    result, _ = finished(started(TOWER, "twisted"))
    for strength in (0.3, 1.5):
        assert gap(with_strength(SOURCE, result, strength)) < 1e-6
    fine = grid(12, 8.0)
    sheets = join(*(TriangleMesh(fine.verts + np.array([0.0, 1.5, z], np.float64), fine.faces) for z in (-0.5, 0.5)))
    around = load_asset(build_glb(sheets.verts, sheets.faces))
    carried = with_edit(SOURCE, edit_of(around, around.replace(twisted(around.surface.positions))))
    assert gap(carried) < 1e-6
    assert with_strength(SOURCE, result, 0.0) == SOURCE.replace(SOURCE.surface.positions)
    # An earlier result, of which every corner is open.
    opened = SOURCE.replace(twisted(SOURCE.surface.positions))
    assert gap(opened) > 0.01
    assert with_strength(SOURCE, opened, 1.0) == opened
