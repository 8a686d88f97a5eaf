"""Write a scene as Wavefront OBJ with its material library and textures.

trimesh's exporter is not used: it encodes textures anew, keeps one texture of a material, and rounds coordinates.

Sources: Wavefront, Object files (.obj) and MTL material format; the PBR extension (`Pr`, `Pm`, `norm`); vertex colours
after the position, as MeshLab and Blender read them.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.mtl_file import MaterialLibrary, line_name
from meshdeform.assets.scene import SceneView
from meshdeform.assets.world import Edges, Frame, WorldMesh, count_edges, place_meshes
from meshdeform.errors import AssetEmptyError

__all__ = ["Obj", "write_obj"]

_WRITTEN = (1980, 1, 1, 0, 0, 0)  # the first time that a ZIP can hold


@dataclass(frozen=True)
class Obj:
    """An OBJ with the files that belong to it, and what is known about its surface.

    Attributes
    ----------
    files : dict of str to bytes
        By their paths relative to the OBJ, which comes first.
    triangles : int
    edges : Edges
    left_out : dict of str to int
        Features of the asset that the files do not have, with their counts.
    """

    files: dict[str, bytes]
    triangles: int
    edges: Edges
    left_out: dict[str, int]

    def to_zip(self) -> bytes:
        """Return all files in one ZIP, the same bytes for the same files."""
        written = io.BytesIO()
        with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as package:
            for name, data in self.files.items():
                package.writestr(zipfile.ZipInfo(name, _WRITTEN), data, zipfile.ZIP_DEFLATED)
        return written.getvalue()


def write_obj(scene: SceneView, frame: Frame = Frame(), stem: str = "result") -> Obj:  # noqa: B008 - immutable
    """Write a scene as OBJ: an object for each node with a mesh, with a material for each primitive.

    Parameters
    ----------
    scene : SceneView
    frame : Frame
        Axes and unit, which the format itself does not store; a comment at the beginning says them, together with the
        open edges and what was left out.
    stem : str
        The files are `STEM.obj`, `STEM.mtl` (without spaces, which an OBJ cannot name) and `textures/...`.

    Returns
    -------
    The same bytes for the same scene. Numbers have as many digits as it takes to read the same 32-bit floats. Nodes are
    applied to positions and normals; v of texture coordinates grows upwards; KHR_texture_transform of the base colour
    is applied to them. There is no library if the scene has no materials.

    Raises
    ------
    AssetEmptyError
        The scene has no triangles.
    AssetError
        A position is not finite, an index is out of range, or an image's data URI is not valid.
    """
    library = MaterialLibrary(scene)
    taken, corners, lines = set[str](), list[NDArray[np.float32]](), list[str]()
    counts = np.ones(3, np.int64)  # OBJ counts from 1
    at: tuple[int, int] | None = None
    for mesh in place_meshes(scene, frame):
        corners.append(mesh.positions[mesh.triangles])
        if (mesh.node.number, mesh.copy) != at:
            at = (mesh.node.number, mesh.copy)
            name = line_name(mesh.node.name or mesh.node.mesh_name, taken, f"node{mesh.node.number}")
            lines.append(f"o {name}")
        lines.extend(_primitive(mesh, library, counts))
    if not corners:
        raise AssetEmptyError("The asset has no triangles that an OBJ could hold.")
    edges, triangles = count_edges(corners), sum(map(len, corners))
    linked = line_name(stem, set(), "result")
    files = library.files(linked)
    left_out = {what: count for what, count in {**scene.left_out, **library.left_out}.items() if count}
    head = [f"# Meshdeform {__version__}: {triangles:,} triangles in {frame.words}; {edges.words}"]
    head += [f"# left out: {count} {what}" for what, count in sorted(left_out.items())]
    head += [f"mtllib {linked}.mtl"] if files else []
    return Obj({f"{stem}.obj": "\n".join([*head, *lines, ""]).encode(), **files}, triangles, edges, left_out)


def _primitive(mesh: WorldMesh, library: MaterialLibrary, counts: NDArray[np.int64]) -> Iterable[str]:
    """Yield the lines of a primitive, and advance the counts of positions, texture coordinates and normals."""
    material = library.use(mesh.primitive.material)
    if material is not None:
        yield f"usemtl {material}"
    values = [mesh.positions, library.coordinates(mesh.primitive), mesh.normals]
    columns: NDArray[np.floating] = mesh.positions
    if mesh.primitive.colors is not None:
        columns = np.column_stack([mesh.positions, np.clip(mesh.primitive.colors[:, :3], 0.0, 1.0)])
    yield from _rows("v", columns, "%.9g")
    if values[1] is not None:
        yield from _rows("vt", values[1], "%.12g")
    if values[2] is not None:
        yield from _rows("vn", values[2], "%.9g")
    # v, v/vt, v//vn or v/vt/vn, each with its own count
    pieces = ["%d", "" if values[1] is None else "%d", "" if values[2] is None else "%d"]
    pattern = "/".join(pieces).rstrip("/")
    used = [k for k in range(3) if values[k] is not None]
    corners = np.stack([mesh.triangles + counts[k] for k in used], axis=-1).reshape(len(mesh.triangles), -1)
    yield from _rows("f", corners, pattern, len(used))
    for k in used:
        counts[k] += len(mesh.positions)


def _rows(key: str, values: NDArray[np.generic], pattern: str, group: int = 1) -> Iterable[str]:
    line = " ".join([key, *[pattern] * (values.shape[1] // group)])
    for row in values.tolist():
        yield line % tuple(row)
