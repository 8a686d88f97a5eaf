"""Create the guidance `target` from the files and parameters of a job, and measure how well the result fits."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from meshdeform.assets import Asset
from meshdeform.deformation.stand_in import stand_in_of
from meshdeform.errors import AlignmentError, ParameterError
from meshdeform.geometry.fit_quality import measure_fit
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import weld
from meshdeform.guidance.alignment import Alignment, aligned, require_overlap, shared_coordinates
from meshdeform.guidance.landmarks import Landmark, LandmarkTerm
from meshdeform.guidance.points import diagonal_of
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.cameras import Frame, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.requests.choices import AlignMode
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.landmarks import Place
from meshdeform.runs.text_deform_checks import check_places

__all__ = ["TargetFit"]

_STYLE = RenderStyle(view_size=160, supersample=1)
_COVERED = 0.25
"""Least blue of a covered pixel: normals as colours have at least a half, and the background none."""
_COLOURS = ((255, 255, 255), (222, 143, 5), (1, 115, 178), (110, 110, 110))
"""Neither, the target alone, the asset alone, both."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TargetFit:
    """The target of a job, placed on its asset.

    Attributes
    ----------
    target : TriangleMesh
        In the cameras' frame.
    alignment : Alignment
        From the target file's world to that of the asset.
    landmarks : tuple of Landmark
        In the cameras' frame.
    """

    target: TriangleMesh
    alignment: Alignment
    landmarks: tuple[Landmark, ...]

    @classmethod
    def of(cls, params: ResolvedParams, asset: Asset, world: TriangleMesh, target: Asset) -> TargetFit:
        """Align the target with the asset.

        Parameters
        ----------
        params : ResolvedParams
        asset : Asset
        world : TriangleMesh
            The asset's welded mesh in its world.
        target : Asset

        Raises
        ------
        ParameterError
            A landmark is a vertex that does not exist.
        AlignmentError
            The surfaces are too far apart; the error has a picture of both.
        """
        surface = target.surface
        goal = weld(surface.positions, surface.triangles).mesh
        check_places(params, {"target": target.summary.bounds})
        landmarks = tuple(
            Landmark(
                _place(pair.source, asset.surface.positions, number, "source"),
                _place(pair.target, surface.positions, number, "target"),
            )
            for number, pair in enumerate(params.landmarks)
        )
        if params.align is AlignMode.AUTO:
            alignment = aligned(goal, world, landmarks)
            advice = "Turn the target so that it is upright as the asset is."
        else:
            alignment = shared_coordinates(goal, world)
            advice = "Set params.guidance.align to auto, or move the target to the asset."
        frame = Frame.around(world.verts)
        placed = frame.place(alignment.place_mesh(goal))
        try:
            require_overlap(alignment, advice)
        except AlignmentError as error:
            error.picture = overlay_png(frame.place(world), placed)
            raise
        moved = (
            Landmark(_entered(frame, each.source), _entered(frame, alignment.place(each.target[None])[0]))
            for each in landmarks
        )
        return cls(placed, alignment, tuple(moved))

    def guidance(self, rest: TriangleMesh, params: ResolvedParams, device: str, sha256: str) -> TargetGuidance:
        """Return the guidance towards the target for a mesh at rest in the cameras' frame."""
        offset = torch.zeros(3, dtype=torch.float64)
        # What a region or a handle places must not be moved afterwards.
        shifts = not (params.regions or params.handles)
        if params.align is not AlignMode.AUTO and shifts:
            # The solve keeps the centre of mass of the asset, so the difference is a translation.
            offset = RestMesh.of(self.target).centre_of_mass() - RestMesh.of(rest).centre_of_mass()
        return TargetGuidance(
            stand_in_of(self.target),
            device=device,
            identity={"id": "target", "revision": "", "sha256": sha256},
            point_weight=params.point_weight,
            seed=params.seed,
            landmarks=self.landmarks,
            offset=offset,
            shifts=shifts,
        )

    def measure(self, rest: TriangleMesh, verts: Tensor) -> dict[str, Any]:
        """Return `fit` of the report for a result (V, 3) in the cameras' frame; distances as shares of the diagonal."""
        result = TriangleMesh(verts, rest.faces)
        found: dict[str, Any] = {
            **measure_fit(result, self.target).to_dict(),
            "silhouettes": _silhouette_overlap(result, self.target),
            "alignment": self.alignment.to_dict(),
        }
        if self.landmarks:
            reached = _landmark_distances(rest, verts, self.landmarks) / diagonal_of(self.target)
            found["landmarks"] = {"count": len(reached), "mean": float(reached.mean()), "max": float(reached.max())}
        return found


def overlay_png(source: TriangleMesh, target: TriangleMesh) -> bytes:
    """Draw the silhouettes of an asset (blue) and a target (orange) over each other, from four sides."""
    both = torch.cat([source.verts, target.verts])
    middle = (both.amin(0) + both.amax(0)) / 2
    scale = 0.9 / float((both - middle).norm(dim=1).max())
    masks = [_masks(TriangleMesh((mesh.verts - middle) * scale, mesh.faces)) for mesh in (source, target)]
    rows = np.concatenate(list((2 * masks[0].astype(int) + masks[1])[:4]), 1)
    buffer = io.BytesIO()
    Image.fromarray(np.array(_COLOURS, np.uint8)[rows]).save(buffer, "PNG")
    return buffer.getvalue()


def _silhouette_overlap(mesh: TriangleMesh, target: TriangleMesh) -> float:
    ours, theirs = _masks(mesh), _masks(target)
    return float((ours & theirs).sum() / max((ours | theirs).sum(), 1))


@torch.no_grad()
def _masks(mesh: TriangleMesh) -> NDArray[np.bool_]:
    """Return the covered pixels (8, S, S) from eight azimuths."""
    renderer = Renderer(mesh.faces, len(mesh.verts), _STYLE)
    views = [renderer.render(mesh.verts, fixed_cameras(azimuth, 15.0)) for azimuth in (0.0, 45.0)]
    return np.asarray(torch.cat(views)[..., 2].numpy() > _COVERED)


def _landmark_distances(rest: TriangleMesh, verts: Tensor, landmarks: tuple[Landmark, ...]) -> _Floats:
    term = LandmarkTerm(landmarks, 1.0)
    term.begin(rest)
    return term.distances(verts)


def _place(place: Place, positions: _Floats, number: int, name: str) -> _Floats:
    if not isinstance(place, int):
        return np.array(place, np.float64)
    if place < len(positions):
        return np.asarray(positions[place])
    detail = f"params.guidance.landmarks: the {name} has {len(positions)} vertices, and none with the index {place}."
    advice = "Indices begin at 0; or give a position [x, y, z]."
    raise ParameterError.at(["params", "guidance", "landmarks", number, name], detail, advice)


def _entered(frame: Frame, point: _Floats) -> _Floats:
    return np.asarray(frame.enter(torch.from_numpy(point[None])).numpy()[0])
