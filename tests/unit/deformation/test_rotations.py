"""The closest rotation, against the singular value decomposition."""

from __future__ import annotations

import torch

from meshdeform.deformation.rotations import closest_rotations


def by_decomposition(matrices: torch.Tensor) -> torch.Tensor:
    u, _, vh = torch.linalg.svd(matrices)
    signs = torch.ones(len(matrices), 3, dtype=torch.float64)
    signs[:, 2] = torch.linalg.det(u @ vh)
    return u @ torch.diag_embed(signs) @ vh


def test_it_is_the_decompositions() -> None:
    generator = torch.Generator().manual_seed(0)
    matrices = torch.eye(3, dtype=torch.float64) + 0.4 * torch.randn(
        500, 3, 3, generator=generator, dtype=torch.float64
    )
    matrices = matrices[torch.linalg.det(matrices) > 0.05]
    assert len(matrices) > 300
    torch.testing.assert_close(closest_rotations(matrices), by_decomposition(matrices), atol=1e-6, rtol=0)


def test_a_rotation_is_its_own_and_stretching_does_not_turn() -> None:
    angle = torch.tensor(2.5, dtype=torch.float64)
    turn = torch.eye(3, dtype=torch.float64)
    turn[:2, :2] = torch.tensor([[angle.cos(), -angle.sin()], [angle.sin(), angle.cos()]])
    stretch = torch.diag(torch.tensor([3.0, 0.2, 1.0], dtype=torch.float64))
    found = closest_rotations(torch.stack([turn, stretch, turn @ stretch]))
    torch.testing.assert_close(found, torch.stack([turn, torch.eye(3, dtype=torch.float64), turn]), atol=1e-6, rtol=0)


def test_reflections_and_nothing_still_give_rotations() -> None:
    matrices = torch.stack([torch.diag(torch.tensor([1.0, 1.0, -1.0])), torch.zeros(3, 3)]).double()
    found = closest_rotations(matrices)
    torch.testing.assert_close(torch.linalg.det(found), torch.ones(2, dtype=torch.float64))
    torch.testing.assert_close(found @ found.mT, torch.eye(3).double().repeat(2, 1, 1))
