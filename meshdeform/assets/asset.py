"""Load an asset, expose its surface in world space, and write a new shape back into it."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.container import GLB_MAGIC
from meshdeform.assets.document import Document
from meshdeform.assets.draco import decode_draco
from meshdeform.assets.inspect import AssetSummary, asset_format, check_document
from meshdeform.assets.limits import Limits
from meshdeform.assets.meshopt.views import decode_meshopt
from meshdeform.assets.parts import Parts, read_parts
from meshdeform.assets.references import Usage
from meshdeform.assets.scene import SceneView
from meshdeform.assets.surface import Block, Surface, read_surface
from meshdeform.assets.writer import Deformation, write_shape
from meshdeform.errors import AssetTooLargeError
from meshdeform.geometry.coarseness import coarseness_warnings

if TYPE_CHECKING:
    from meshdeform.assets.appearance import Appearance

__all__ = ["Asset", "load_asset"]


class Asset:
    """A loaded asset.

    Attributes
    ----------
    surface : Surface
        The surface to deform, in world space.
    summary : AssetSummary
        Counts, extensions and the source format.
    """

    def __init__(self, document: Document, summary: AssetSummary, source: bytes, usage: Usage) -> None:
        self._document = document
        self._source = source
        self._usage = usage
        self.surface: Surface
        self._blocks: list[Block]
        self.surface, self._blocks = read_surface(document)
        parts = self.parts()
        self.summary = dataclasses.replace(
            summary,
            nodes=tuple(parts.nodes),
            materials=tuple(parts.materials),
            warnings=coarseness_warnings(self.surface.positions, self.surface.triangles),
            vertices=len(self.surface.positions),
            triangles=len(self.surface.triangles),
            skipped=tuple(self.surface.skipped),
        )

    def to_bytes(self) -> bytes:
        """Return the unchanged asset as a GLB: the loaded bytes themselves if they were a GLB."""
        return self._source if self._source.startswith(GLB_MAGIC) else self._document.to_bytes()

    def scene(self) -> SceneView:
        """Return a read-only view of the default scene, for writing other formats.

        Raises
        ------
        AssetError
            A material, texture or image is not valid.
        """
        return SceneView(self._document)

    def appearance(self) -> Appearance:
        """Read how the surface looks, for drawing it; needs Pillow. What cannot be read is replaced and counted."""
        from meshdeform.assets.appearance import read_appearance

        return read_appearance(self._document, self._blocks)

    def parts(self) -> Parts:
        """List the nodes and materials of the surface, and which triangles belong to each."""
        return read_parts(self._document, self._blocks)

    def texture_coordinates(self) -> dict[str, str]:
        """Return the SHA-256 of each decoded texture coordinate set by place of use, to prove UVs unchanged."""
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
        compact: bool = False,
        provenance: Mapping[str, Any] | None = None,
    ) -> bytes:
        """Write the asset with a new shape and everything else unchanged.

        Parameters
        ----------
        positions : (N, 3) float64
            New values of `surface.positions`, in world space.
        normals : (N, 3) float64, optional
            New normals. Rows without a normal in the source are ignored; NaN rows keep the source's. None keeps all.
        tangents : (N, 4) float64, optional
            New tangents, with the same rules.
        morph : bool
            Keep the source as the base and add the new shape as a morph target of weight 1, with a one-second
            animation named "deform" from the source to the result.
        compact : bool
            Drop the data that the new shape made unused. Everything that is still referenced keeps its values and
            its index, but the binary chunk of the source is no longer a prefix of the new one.
        provenance : mapping, optional
            JSON to store as `asset.extras.meshdeform`.

        Returns
        -------
        A GLB. The asset itself is not changed.

        Raises
        ------
        NumericalError
            A new position is not finite, or too large for a 32-bit float.
        ShapeError
            An array does not have as many rows as the surface.
        """
        shape = Deformation.checked(self.surface, positions, normals, tangents)
        source = self._usage if compact else None
        return write_shape(
            self._document.fork(), self._blocks, shape, morph=morph, source=source, provenance=provenance
        )


def load_asset(data: bytes, filename: str = "", limits: Limits | None = None) -> Asset:
    """Read an asset.

    Parameters
    ----------
    data : bytes
        A GLB, a glTF JSON with embedded buffers, an OBJ, PLY or STL.
    filename : str
        Its name. The extension decides the format where the content does not.
    limits : Limits, optional
        Upper bounds on the asset.

    Raises
    ------
    AssetError
        The asset cannot be used; the subclass and message say why and what to do.
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
    usage = Usage.of(document.root, document.binary_length)
    decode_meshopt(document)
    decode_draco(document)
    return Asset(document, summary, source, usage)
