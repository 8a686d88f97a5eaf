"""Place a target on its asset and read the pictures of outlines, and measure how near a result came to them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.silhouette import read_silhouette
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.pictures import SilhouetteView
from meshdeform.geometry.target_distance import measure_fit
from meshdeform.geometry.weld import weld
from meshdeform.guidance.alignment import Alignment, aligned, require_overlap, shared_coordinates
from meshdeform.guidance.landmarks import Landmark, diagonal_of, landmark_distances
from meshdeform.guidance.masks import covered, placed_masks
from meshdeform.rendering.cameras import CameraFrame, fixed_cameras
from meshdeform.requests.choices import AlignMode
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.parameters import SILHOUETTE_FIELDS
from meshdeform.requests.selection import Place
from meshdeform.runs.text_deform_check import check_points, check_vertex

__all__ = ["SilhouetteFit", "TargetFit"]

_SIDE = 160
"""Of the pictures in which the outlines of a result and its target are compared, in pixels."""

_Floats = NDArray[np.float64]


class SilhouetteFit:
    """The pictures of a job.

    `views`: one for each of `params.guidance.silhouettes`; `sha256`: of all pictures.
    """

    def __init__(self, params: ResolvedParams, views: Sequence[SilhouetteView], sha256: str) -> None:
        self.params, self.views, self.sha256 = params, views, sha256

    @classmethod
    def of(cls, params: ResolvedParams, pictures: Sequence[bytes]) -> Self:
        """Read the pictures of a job."""
        if len(pictures) != len(params.silhouettes):
            detail = f"silhouettes has {len(params.silhouettes)} entries, and there are {len(pictures)} pictures."
            raise ParameterError(detail, advice="Give each picture one entry with its azimuth.")
        views = [
            SilhouetteView(read_silhouette(data, f"`{name}`").mask, each.azimuth, each.elevation, each.fov)
            for name, data, each in zip(SILHOUETTE_FIELDS, pictures, params.silhouettes, strict=False)
        ]
        return cls(
            params, views, hashlib.sha256(b"".join(hashlib.sha256(data).digest() for data in pictures)).hexdigest()
        )

    def measure(self, rest: TriangleMesh, verts: _Floats) -> list[dict[str, Any]]:
        """Return `silhouettes` of the report for a result (V, 3) in the cameras' frame."""
        placed = placed_masks(self.views, rest)
        before, after = ([each.overlap(shape, rest.faces) for each in placed] for shape in (rest.verts, verts))
        return [
            {
                "part": name,
                **each.model_dump(mode="json"),
                "iou_before": round(first, 4),
                "iou": round(last, 4),
            }
            for name, each, first, last in zip(SILHOUETTE_FIELDS, self.params.silhouettes, before, after, strict=False)
        ]


@dataclass(frozen=True)
class TargetFit:
    """The target of a job, placed on its asset."""

    target: TriangleMesh  # in the cameras' frame
    alignment: Alignment  # from the target file's world to that of the asset
    landmarks: tuple[Landmark, ...]  # in the cameras' frame

    @classmethod
    def of(
        cls, params: ResolvedParams, asset: Asset, world: TriangleMesh, target: Asset, frame: CameraFrame
    ) -> TargetFit:
        """Align the target with the asset.

        `world`: the asset's welded mesh in its world; `frame`: the cameras' frame.
        """
        surface = target.surface
        goal = weld(surface.positions, surface.triangles).mesh
        check_points(params, {"target": target.summary.bounds})
        landmarks = tuple(
            Landmark(
                _point_of(pair.source, asset.surface.positions, number, "source"),
                _point_of(pair.target, surface.positions, number, "target"),
            )
            for number, pair in enumerate(params.landmarks)
        )
        if params.align is AlignMode.AUTO:
            alignment = aligned(goal, world, landmarks)
            advice = "Turn the target so that it is upright as the asset is."
        else:
            alignment = shared_coordinates(goal, world)
            advice = "Set params.guidance.align to auto, or move the target to the asset."
        placed = frame.place(alignment.place_mesh(goal))
        require_overlap(alignment, advice)
        moved = (
            Landmark(_entered(frame, each.source), _entered(frame, alignment.place(each.target[None])[0]))
            for each in landmarks
        )
        return cls(placed, alignment, tuple(moved))

    def measure(self, rest: TriangleMesh, verts: _Floats) -> dict[str, Any]:
        """Return `fit` of the report for a result (V, 3) in the cameras' frame; distances as shares of the diagonal.

        `before` has the same distances of the source.
        """
        result = TriangleMesh(verts, rest.faces)
        measured: dict[str, Any] = {
            **measure_fit(result, self.target).to_dict(),
            "before": measure_fit(rest, self.target).to_dict(),
            "silhouettes": _silhouette_overlap(result, self.target),
            "alignment": self.alignment.to_dict(),
        }
        if self.landmarks:
            reached = landmark_distances(self.landmarks, rest, verts) / diagonal_of(self.target)
            measured["landmarks"] = {"count": len(reached), "mean": float(reached.mean()), "max": float(reached.max())}
        return measured


def _silhouette_overlap(mesh: TriangleMesh, target: TriangleMesh) -> float:
    """Return the intersection over union of what both cover, seen from eight azimuths."""
    cameras = [fixed_cameras(azimuth, 15.0) for azimuth in (0.0, 45.0)]
    ours, theirs = (
        np.concatenate([covered(each.verts, each.faces, around, _SIDE) for around in cameras])
        for each in (mesh, target)
    )
    return float((ours & theirs).sum() / max((ours | theirs).sum(), 1))


def _point_of(given: Place, positions: _Floats, number: int, name: str) -> _Floats:
    if not isinstance(given, int):
        return np.array(given, np.float64)
    check_vertex(("guidance", "landmarks", number, name), given, len(positions))
    return np.asarray(positions[given])


def _entered(frame: CameraFrame, point: _Floats) -> _Floats:
    return np.asarray(frame.enter(point[None])[0])
