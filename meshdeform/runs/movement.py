"""Measure how far a run moved its mesh, and say what stopped one that hardly moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from torch import Tensor

from meshdeform.geometry.rest_mesh import RestMesh

__all__ = ["HoldCounter", "Movement", "measure_movement"]

_STALLED = 0.01
"""Root mean square displacement, as a share of the diagonal, below which a result looks like its source."""
_MOSTLY = 0.5
_REMEDIES = {
    "safeguard": "Set params.safeguard to flips: the surface may then intersect itself. A mesh without doubled or "
    "intersecting surfaces needs no such exception.",
    "guidance": "Use more steps, or a prompt that differs more from the asset.",
}
_CAUSES = {
    "safeguard": "the safeguard held back {held:.0%} of it",
    "guidance": "the guidance hardly pulled at it",
}


@dataclass(frozen=True)
class Movement:
    """How far a run moved its mesh.

    Attributes
    ----------
    rms : float
        Area-weighted root mean square displacement, as a share of the diagonal of the source's bounding box.
    held_share : float
        Mean share of the faces, or of the cells of a lattice, that the safeguard held back when it checked.
    stalled_by : str, optional
        What mostly held back a mesh that hardly moved: `safeguard` or `guidance`; None if it moved.
    """

    rms: float
    held_share: float
    stalled_by: str | None

    def to_dict(self) -> dict[str, float | str | None]:
        """Return the figures by name."""
        return asdict(self)

    @property
    def warnings(self) -> list[str]:
        """Sentences for the user: what held back a mesh that hardly moved, and what to do; empty if it moved."""
        if self.stalled_by is None:
            return []
        cause = _CAUSES[self.stalled_by].format(held=self.held_share)
        return [f"The mesh hardly moved ({self.rms:.1%} of its size): {cause}. {_REMEDIES[self.stalled_by]}"]


class HoldCounter:
    """Collects the shares of the surface that the safeguard held back in one attempt."""

    def __init__(self) -> None:
        self._held: list[float] = []

    def add(self, losses: Mapping[str, float], *, checked: bool) -> None:
        """Add one step; `checked` says whether the safeguard checked the surface after it."""
        if checked and "held_share" in losses:
            self._held.append(losses["held_share"])

    def share(self) -> float:
        """Return the mean share that the safeguard held back."""
        return float(np.mean(self._held)) if self._held else 0.0


def measure_movement(rest: RestMesh, verts: Tensor, holds: HoldCounter) -> Movement:
    """Compare a deformed mesh with its rest state.

    Parameters
    ----------
    rest : RestMesh
    verts : (V, 3) float64
        Deformed positions in the same unit.
    holds : HoldCounter
        Of the run.
    """
    weights = rest.vertex_areas
    used = rest.verts.numpy()[np.unique(rest.faces.numpy())]
    diagonal = float(np.linalg.norm(np.ptp(used, axis=0))) if len(used) else 0.0
    squared = ((verts.numpy() - rest.verts.numpy()) ** 2).sum(1)
    total = float(weights.sum())
    rms = float(np.sqrt((weights * squared).sum() / total)) / diagonal if total > 0 and diagonal > 0 else 0.0
    held = holds.share()
    stalled_by = None
    if rms < _STALLED:
        stalled_by = "safeguard" if held > _MOSTLY else "guidance"
    return Movement(rms, held, stalled_by)
