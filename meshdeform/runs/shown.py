"""Show a source and its result as viewers do: skins in the pose of the file's nodes, not in their bind pose."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from meshdeform.assets import Asset, Surface
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.studio import Pose

__all__ = ["Shown"]


@dataclass(frozen=True)
class Shown:
    """What viewers show of a source and of its result.

    Attributes
    ----------
    source, result : TriangleMesh
        The welded surfaces, +Y up, with the same faces.
    poses : tuple of Pose
        Of all vertices of the files, for pictures: source and result.
    skinned : bool
        Whether the asset has a skin, so that these shapes may differ from those of the bind pose.
    """

    source: TriangleMesh
    result: TriangleMesh
    poses: tuple[Pose, Pose]
    skinned: bool

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
        if not asset.rig().joints:
            # Not rounded to the precision of the file.
            result = TriangleMesh(verts, welded.mesh.faces)
            return cls(welded.mesh, result, _poses(asset.surface, written.surface), skinned=False)
        before, after = asset.posed(), written.posed()
        shapes = welded.gather(before.positions), welded.gather(after.positions)
        return cls(*shapes, _poses(before, after), skinned=True)


def _poses(before: Surface, after: Surface) -> tuple[Pose, Pose]:
    return Pose(before.positions, before.normals), Pose(after.positions, after.normals)
