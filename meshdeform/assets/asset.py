"""An asset: read once, its surface handed out in the world, its new shape written back where it came from."""

from __future__ import annotations

import dataclasses
import hashlib

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.container import GLB_MAGIC
from meshdeform.assets.document import Document
from meshdeform.assets.draco import decode_draco
from meshdeform.assets.inspect import AssetSummary, asset_format, check_document
from meshdeform.assets.limits import Limits
from meshdeform.assets.meshopt.views import decode_meshopt
from meshdeform.assets.scene import SceneView
from meshdeform.assets.surface import Block, Surface, read_surface
from meshdeform.assets.writer import Deformation, write_shape
from meshdeform.errors import AssetTooLargeError

__all__ = ["Asset", "load_asset"]


class Asset:
    """A loaded asset.

    Attributes
    ----------
    surface : Surface
        What there is to deform, in the world.
    summary : AssetSummary
        Counts, extensions and the format it came in.
    """

    def __init__(self, document: Document, summary: AssetSummary, source: bytes) -> None:
        self._document = document
        self._source = source
        self.surface: Surface
        self._blocks: list[Block]
        self.surface, self._blocks = read_surface(document)
        self.summary = dataclasses.replace(
            summary,
            vertices=len(self.surface.positions),
            triangles=len(self.surface.triangles),
            skipped=tuple(self.surface.skipped),
        )

    def to_bytes(self) -> bytes:
        """Return the untouched asset as a GLB: the very bytes that were loaded where these were one."""
        return self._source if self._source.startswith(GLB_MAGIC) else self._document.to_bytes()

    def scene(self) -> SceneView:
        """Return a read-only view of the default scene, for those who write another format.

        Raises
        ------
        AssetError
            A material, texture or image is not valid.
        """
        return SceneView(self._document)

    def texture_coordinates(self) -> dict[str, str]:
        """SHA-256 of every texture coordinate set as decoded, by where it is used: proof that UVs are the same."""
        found: dict[str, str] = {}
        for number, block in enumerate(self._blocks):
            for p in block.primitives:
                attributes = self._document.root["meshes"][block.mesh]["primitives"][p]["attributes"]
                for name in sorted(a for a in attributes if a.startswith("TEXCOORD_")):
                    values = read_floats(self._document, attributes[name])
                    found[f"{number}/{p}/{name}"] = hashlib.sha256(values.tobytes()).hexdigest()
        return found

    def replace(
        self,
        positions: NDArray[np.float64],
        normals: NDArray[np.float64] | None = None,
        tangents: NDArray[np.float64] | None = None,
        *,
        morph: bool = False,
    ) -> bytes:
        """Write the asset with a new shape; everything else comes back as it was.

        Parameters
        ----------
        positions : (N, 3) float64
            New positions of `surface.positions`, in the world.
        normals : (N, 3) float64, optional
            New normals; rows without one in the source are ignored, NaN rows keep the source's. None keeps all.
        tangents : (N, 4) float64, optional
            New tangents, in the same way.
        morph : bool
            Keep the source as the base and add the new shape as a morph target, of weight 1, with an animation
            named "deform" from the source to the result in one second.

        Returns
        -------
        A GLB. The asset itself is not changed.

        Raises
        ------
        NumericalError
            A new position is not finite, or too large for a 32-bit float.
        ShapeError
            An array has another number of rows than the surface.
        """
        shape = Deformation.checked(self.surface, positions, normals, tangents)
        return write_shape(self._document.fork(), self._blocks, shape, morph=morph)


def load_asset(data: bytes, filename: str = "", limits: Limits | None = None) -> Asset:
    """Read an asset.

    Parameters
    ----------
    data : bytes
        A GLB, a glTF JSON with embedded buffers, an OBJ, PLY or STL.
    filename : str
        Its name; the ending decides where the content does not.
    limits : Limits, optional
        What is allowed.

    Raises
    ------
    AssetError
        One of its subclasses says what is wrong and what to do.
    """
    limits = limits or Limits()
    if len(data) > limits.max_bytes:
        raise AssetTooLargeError(
            f"The file has {len(data)} bytes; the limit is {limits.max_bytes} (MESHDEFORM_MAX_UPLOAD_BYTES)."
        )
    kind = asset_format(data, filename)
    source = data
    if kind not in {"glb", "gltf"}:
        from meshdeform.assets.convert import convert_to_glb

        source = data = convert_to_glb(data, kind, limits)
    document = Document.parse(data, limits, glb=kind != "gltf")
    summary = check_document(document.root, document.binary_length, limits, kind)
    decode_meshopt(document)
    decode_draco(document)
    return Asset(document, summary, source)
