"""The arrangement of views: which cameras, which picture."""

from __future__ import annotations

import pytest
import torch

from meshdeform.rendering.cameras import CameraRange
from meshdeform.rendering.shading import OrthogonalGrid, RenderStyle


def test_four_views_a_quarter_turn_apart_fill_one_picture() -> None:
    views = OrthogonalGrid(CameraRange(), RenderStyle(view_size=24))
    cameras = views.sample(torch.Generator().manual_seed(0), 1.05)
    turns = [(b - a) % 360 for a, b in zip(cameras.azimuths_deg, cameras.azimuths_deg[1:], strict=False)]
    assert turns == pytest.approx([90.0] * 3)
    images = torch.arange(4.0).view(4, 1, 1, 1).expand(4, 24, 24, 3)
    picture = views.arrange(images)
    assert picture.shape == (1, 3, 48, 48)
    assert picture[0, 0, ::47, ::47].tolist() == [[0, 1], [2, 3]]
