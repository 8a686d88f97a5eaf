"""torch's threads share what a network computes, and stay out of everything short."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.base import Guidance, StepContext
from meshdeform.rendering.shading import RenderStyle
from tests.cases import each_case
from tests.unit.deformation.worlds import params


class Light:
    """A guidance that notes how many threads torch has."""

    style = RenderStyle(view_size=8)
    identity: ClassVar[dict[str, str]] = {}

    def __init__(self) -> None:
        self.threads: list[int] = []

    def loss(self, image: Tensor, _context: StepContext) -> tuple[Tensor, dict[str, float]]:
        self.threads.append(torch.get_num_threads())
        return image.square().sum(), {}


class Heavy(Light):
    is_heavy = True


@each_case(("guidance", "during"), [(Light(), 1), (Heavy(), 3)])
def test_torch_has_its_threads_only_where_operations_are_long(guidance: Light, during: int) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        seen: Guidance = guidance
        for _ in Deformation(icosphere(1), seen, params(steps=2, guidance="sds", orientation="keep")):
            assert torch.get_num_threads() == 3
        assert guidance.threads == [during] * 2
    finally:
        torch.set_num_threads(before)
