"""Define the interface of a guidance: a loss on the rendered views."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import torch
from torch import Tensor

from meshdeform.geometry.torch_threads import one_torch_thread

if TYPE_CHECKING:
    from collections.abc import Mapping

    from meshdeform.geometry.mesh import TriangleMesh
    from meshdeform.rendering.cameras import Cameras
    from meshdeform.rendering.shading import RenderStyle


@dataclass(frozen=True)
class StepContext:
    """Information about a step that a guidance gets besides the image."""

    step: int  # number of steps before this one
    total_steps: int  # number of steps of the whole run; the same in a resumed run
    cameras: Cameras  # the four cameras of the image, or one for each picture
    generator: torch.Generator
    """The job's only source of randomness. Draw on the CPU and move the result, so that a seed gives the same numbers
    on every device."""

    @property
    def fraction(self) -> float:
        """Progress of the run: 0 at the first step, 1 at the last."""
        return self.step / max(self.total_steps - 1, 1)


class Guidance(Protocol):
    """A loss on the rendered views."""

    @property
    def style(self) -> RenderStyle:
        """Required style of the views."""

    @property
    def identity(self) -> dict[str, str]:
        """`id`, `revision` and `sha256`, for the report."""

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Compute the loss on the views.

        Parameters
        ----------
        image : (1, 3, S, S) or (B, 3, S, S) float32 in [0, 1]
            The four views in one picture (`views.combine_views`), or one picture for each camera.

        Returns
        -------
        A scalar that is differentiable in `image`, and named numbers for the log.

        Raises
        ------
        NumericalError
            The loss is not finite.
        """


@runtime_checkable
class RegionalGuidance(Protocol):
    """A guidance with several losses on the same views, each of which may reach another part of the surface."""

    def losses(self, image: Tensor, context: StepContext) -> tuple[list[Tensor], dict[str, float]]:
        """Compute the losses of which `loss` is the sum; parameters and errors are those of `loss`."""


@runtime_checkable
class HeavyGuidance(Protocol):
    """A guidance that may have a network large enough for torch's threads; operations of all others are short."""

    @property
    def is_heavy(self) -> bool:
        """Whether torch's threads should share the operations of a step."""


@runtime_checkable
class ShapeGuidance(Protocol):
    """A guidance that compares the shape itself as well, and places it."""

    @property
    def offset(self) -> Tensor:
        """Translation (3,) float64 of the deformed mesh, which the solve keeps at its centre of mass."""

    def begin(self, mesh: TriangleMesh) -> None:
        """Prepare for the mesh at rest that is deformed: the stand-in of a large one."""

    def shape_loss(self, verts: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Return a scalar float64, differentiable in the vertices (V, 3) without the offset, and values for the log."""

    @property
    def state(self) -> dict[str, Tensor]:
        """Return the state that changes during a run, for checkpoints."""

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Continue from `state`."""


def torch_threads_for(guidance: Guidance) -> AbstractContextManager[None]:
    """Let torch compute on one thread inside the block, unless the guidance is heavy; other operations are short."""
    heavy = isinstance(guidance, HeavyGuidance) and guidance.is_heavy
    return nullcontext() if heavy else one_torch_thread()
