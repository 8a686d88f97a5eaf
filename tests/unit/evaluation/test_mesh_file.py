"""The benchmark's PLY files."""

from __future__ import annotations

import pytest
import torch

from meshdeform.assets import load_asset
from meshdeform.errors import AssetFormatError
from tests.cases import each_case
from training.evaluation.mesh_file import read_ply, write_ply
from training.evaluation.relaxed import geodesic_sphere


def test_a_mesh_comes_back_bit_for_bit() -> None:
    mesh = geodesic_sphere(3)
    back = read_ply(write_ply(mesh))
    assert torch.equal(back.verts, mesh.verts)
    assert torch.equal(back.faces, mesh.faces)


def test_other_programs_read_the_file() -> None:
    mesh = geodesic_sphere(3)
    surface = load_asset(write_ply(mesh), "mesh.ply").surface
    assert len(surface.triangles) == len(mesh.faces)
    assert surface.positions == pytest.approx(mesh.verts.numpy())


@each_case("cut", [-1, 40, 0])
def test_a_file_that_is_not_whole_is_refused(cut: int) -> None:
    with pytest.raises(AssetFormatError):
        read_ply(write_ply(geodesic_sphere(1))[:cut])
