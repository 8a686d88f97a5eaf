"""Show a source and its result as viewers do: skins in the pose of the file's nodes, not in their bind pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.assets import Asset, Surface
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import Frame
from meshdeform.rendering.studio import Pose

__all__ = ["Shown", "pose_in_frame"]


@dataclass(frozen=True)
class Shown:
    """What viewers show of a source and of its result.

    Attributes
    ----------
    source, result : TriangleMesh
        The welded surfaces, +Y up, with the same faces.
    poses : tuple of Pose
        Of all vertices of the files, for pictures: source and result.
    posed : bool
        Whether the asset has a skin, and these are not the shapes of the bind pose.
    """

    source: TriangleMesh
    result: TriangleMesh
    poses: tuple[Pose, Pose]
    posed: bool

    @classmethod
    def of(cls, asset: Asset, written: Asset, welded: WeldedMesh, verts: Tensor) -> Shown:
        """Pose the source and the result, read back from its file.

        Parameters
        ----------
        asset, written : Asset
        welded : WeldedMesh
            The source in its bind pose.
        verts : (V, 3) float64
            Deformed positions of the welded vertices, in the bind pose.
        """
        if asset.rig().joints:
            before, after = asset.posed(), written.posed()
            source, result = welded.gather(before.positions), welded.gather(after.positions)
            # A pose that hides all of it, with joints scaled to nothing, says nothing about it.
            if _has_area(source) and _has_area(result):
                return cls(source, result, _poses(before, after), posed=True)
        # Not rounded to the precision of the file.
        result = TriangleMesh(verts, welded.mesh.faces)
        return cls(welded.mesh, result, _poses(asset.surface, written.surface), posed=False)


def pose_in_frame(asset: Asset, welded: WeldedMesh, frame: Frame) -> NDArray[np.float64] | None:
    """Return the affine map (V, 3, 4) from each welded vertex in the frame to where viewers show it, in the frame.

    None if that is the same place, or if the pose hides all of the surface.
    """
    if not asset.rig().joints:
        return None
    maps = asset.pose_maps()[welded.first_rows()]
    if np.allclose(maps, np.eye(3, 4), rtol=0, atol=1e-9) or not _has_area(welded.gather(asset.posed().positions)):
        return None
    linear, centre = maps[:, :, :3], frame.centre.numpy()
    shift = frame.scale * (linear @ centre + maps[:, :, 3] - centre)
    return np.concatenate([linear, shift[:, :, None]], axis=2)


def _has_area(mesh: TriangleMesh) -> bool:
    return bool(mesh.verts.isfinite().all()) and bool((RestMesh.of(mesh).areas > 0).any())


def _poses(before: Surface, after: Surface) -> tuple[Pose, Pose]:
    return Pose(before.positions, before.normals), Pose(after.positions, after.normals)
