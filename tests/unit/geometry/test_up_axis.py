"""A mesh that plainly stands on its lowest Z is noticed; everything else is not."""

from __future__ import annotations

import numpy as np
import torch

from meshdeform.assets.notices import looks_z_up
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import box, lathe
from tests.cases import each_case
from training.evaluation.sources import SOURCES, source_mesh


def answer(mesh: TriangleMesh) -> bool:
    return looks_z_up(mesh.verts.numpy(), mesh.faces.numpy())


def with_z_up(mesh: TriangleMesh) -> TriangleMesh:
    """The mesh as a program with Z up exports it: X, -Z, Y."""
    return TriangleMesh(mesh.verts[:, [0, 2, 1]] * torch.tensor([1.0, -1.0, 1.0], dtype=torch.float64), mesh.faces)


STATUE = lathe([(0.0, 0.0), (0.5, 0.0), (0.4, 0.3), (0.1, 0.6), (0.3, 1.2), (0.0, 1.6)])


def test_what_stands_on_its_lowest_z_is_noticed() -> None:
    assert answer(with_z_up(STATUE))
    assert not answer(STATUE)


@each_case("name", SOURCES)
def test_a_source_with_y_up_is_not_mistaken(name: str) -> None:
    assert not answer(source_mesh(name))


def test_a_panel_and_an_empty_mesh_say_nothing() -> None:
    assert not answer(box(2, (1.0, 1.0, 0.05)))
    assert not looks_z_up(np.zeros((3, 3)), np.zeros((0, 3), np.int64))
    assert not looks_z_up(np.zeros((3, 3)), np.array([[0, 1, 2]]))
