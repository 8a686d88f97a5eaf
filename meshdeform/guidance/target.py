"""Use a second mesh as guidance: compare pictures of both from the same cameras, and their surfaces (`points.py`).

::

    loss = mean over pixels and colours of ((image - target) / 0.1)^2

Views show camera-space normals on black. The blue channel of a visible surface is at least one half, so one picture
compares both orientation and silhouette. Colours are measured in tenths of their range, which puts `guidance_weight` 1
well above the regularisers' defaults.

Additional blurred levels were tried and left out: a mesh that fills the same sphere as its target overlaps it from the
start, and from a sphere to a cow they were slower (after 300 steps, the mean distance between the two surfaces was
0.0099 of the radius with them and 0.0086 without).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from meshdeform.errors import NumericalError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.tensors import faces_of, verts_of
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.landmarks import Landmark, diagonal_of
from meshdeform.guidance.points import EVERY_STEPS, LandmarkTerm, PointTerm
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.rendering.views import combine_views

TARGET_STYLE = RenderStyle(view_size=64, supersample=2, shading="normals", background=(0.0, 0.0, 0.0))
_COLOUR_SCALE = 0.1
_ROUNDING = 1e-4
"""Difference of colours that counts as none."""


@dataclass(frozen=True)
class Shift:
    """A translation (3,) float64 with which the deformed mesh starts, and whether it may change.

    It may not where some of the mesh must stay in place.
    """

    offset: Tensor = field(default_factory=lambda: torch.zeros(3, dtype=torch.float64))
    free: bool = True


class TargetGuide:
    """Guides the views towards those of a target mesh, and the surface towards its surface.

    Parameters
    ----------
    mesh : TriangleMesh
        The target, in the frame of the deformed mesh.
    identity : dict of str to str, optional
        Identity of the target in the report; by default a hash of its vertices and faces.
    point_weight : float
        Weight of the distances between the surfaces; 0: only the views are compared.
    seed : int
        Of the samples whose distances are taken.
    landmarks : sequence of Landmark
        Points that go to others, in the frame of the deformed mesh.
    shift : Shift, optional
        Translation of the deformed mesh.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        *,
        style: RenderStyle = TARGET_STYLE,
        device: str | torch.device = "cpu",
        identity: dict[str, str] | None = None,
        point_weight: float = 0.0,
        seed: int = 0,
        landmarks: Sequence[Landmark] = (),
        shift: Shift | None = None,
    ) -> None:
        shift = shift or Shift()
        self.style = style
        self.identity = identity or {"id": "target", "revision": "", "sha256": _sha256(mesh)}
        self._verts = verts_of(mesh).to(device)
        self._renderer = Renderer(faces_of(mesh), len(mesh.verts), style, device)
        self._points = PointTerm(mesh, seed=seed) if point_weight else None
        self._point_weight = point_weight
        self._landmarks = LandmarkTerm(landmarks, diagonal_of(mesh)) if landmarks else None
        self.offset, self._shifts = shift.offset, shift.free
        self._paired: dict[str, Tensor] = {}

    def begin(self, mesh: TriangleMesh) -> None:
        """Prepare for the mesh at rest that is deformed."""
        for term in (self._points, self._landmarks):
            if term is not None:
                term.begin(mesh)

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Compare the views with those of the target from the same cameras.

        Returns
        -------
        The loss above, 0 for equal pictures; and `target_mse`, the mean squared difference of colours in [0, 1].

        Raises
        ------
        ShapeError
            `image` does not have the size that `style` specifies.
        NumericalError
            The loss is not finite.
        """
        with torch.no_grad():
            placed = self._verts - self.offset.to(self._verts)
            target = combine_views(self._renderer.render(placed, context.cameras))
        if image.shape != target.shape:
            raise ShapeError(f"expected an image {tuple(target.shape)}, got {tuple(image.shape)}")
        apart = image - target
        # Rounding errors alone would move a mesh that is already where it should be, since Adam scales gradients up.
        error = torch.where(apart.abs() < _ROUNDING, 0.0, apart).square().mean()
        if not torch.isfinite(error):
            raise NumericalError(f"The views cannot be compared with the target at step {context.step + 1}.")
        return error / _COLOUR_SCALE**2, {"target_mse": error.item()}

    def shape_loss(self, verts: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        """Return the distances between the surfaces and of the landmarks; and `paired_share`, of the samples."""
        total, logs = verts.sum() * 0.0, {}
        if self._points is not None:
            if context.step % EVERY_STEPS == 0 or not self._paired:
                self._pair(verts.detach(), context.fraction)
            distances, logs["paired_share"] = self._points.loss(verts, self.offset)
            total = total + self._point_weight * distances
        if self._landmarks is not None:
            total = total + self._landmarks.loss(verts, self.offset)
        return total, logs

    def _pair(self, verts: Tensor, fraction: float) -> None:
        assert self._points is not None
        before = self.offset
        # The pairs of a resumed run are found again from what they were found from.
        self._paired = {
            "fit.verts": verts.clone(),
            "fit.before": before,
            "fit.fraction": torch.tensor([fraction], dtype=torch.float64),
        }
        pairs = self._points.pair(verts, before, fraction)
        self.offset = before + pairs if self._shifts else before

    @property
    def state(self) -> dict[str, Tensor]:
        """The offset, and the shape for which pairs were found last."""
        return {"fit.offset": self.offset, **self._paired}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Continue from `state`."""
        self.offset = state["fit.offset"]
        self._paired = {}
        if self._points is not None and "fit.verts" in state:
            self._pair_again(state)

    def _pair_again(self, state: Mapping[str, Tensor]) -> None:
        self.offset = state["fit.before"]
        self._pair(state["fit.verts"], float(state["fit.fraction"]))


def _sha256(mesh: TriangleMesh) -> str:
    digest = hashlib.sha256(mesh.verts.tobytes())
    digest.update(mesh.faces.tobytes())
    return digest.hexdigest()
