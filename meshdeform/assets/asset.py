"""Load an asset, expose its surface in world space, and write a new shape back into it."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.archive import Archive, open_archive
from meshdeform.assets.backdrop import backdrop_warnings
from meshdeform.assets.bundle import pack_gltf
from meshdeform.assets.container import GLB_MAGIC
from meshdeform.assets.document import Document
from meshdeform.assets.draco import decode_draco
from meshdeform.assets.embed import embed_data_uris
from meshdeform.assets.inspect import AssetSummary, asset_format, check_document
from meshdeform.assets.limits import Limits
from meshdeform.assets.meshopt.views import decode_meshopt
from meshdeform.assets.parts import Parts, read_parts
from meshdeform.assets.references import Usage
from meshdeform.assets.repair import rebuild_directions
from meshdeform.assets.scene import SceneView
from meshdeform.assets.surface import Block, Surface, read_surface
from meshdeform.assets.writer import Deformation, write_shape
from meshdeform.errors import AssetFormatError, AssetTooLargeError
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
        Counts, extensions, warnings and the source format.
    repairs : Repairs
        How many normals and tangents had no direction and were rebuilt.
    """

    def __init__(self, document: Document, summary: AssetSummary, source: bytes, usage: Usage) -> None:
        self._document = document
        self.repairs = rebuild_directions(document)
        self._source = source
        self._usage = usage
        self.surface: Surface
        self._blocks: list[Block]
        self.surface, self._blocks, self._loose = read_surface(document)
        backdrops = backdrop_warnings(document, self.surface, self._blocks)
        parts = self.parts()
        coarse = coarseness_warnings(self.surface.positions, self.surface.triangles)
        self.summary = dataclasses.replace(
            summary,
            nodes=tuple(parts.nodes),
            materials=tuple(parts.materials),
            vertices=len(self.surface.positions),
            triangles=len(self.surface.triangles),
            skipped=tuple(self.surface.skipped),
            warnings=(*summary.warnings, *self.repairs.warnings, *backdrops, *coarse),
        )

    def to_bytes(self) -> bytes:
        """Return the unchanged asset as a GLB: the loaded bytes themselves if they were a GLB."""
        if self._source.startswith(GLB_MAGIC):
            return self._source
        document = self._document.fork()
        embed_data_uris(document)
        return document.to_bytes()

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
        document = self._document.fork()
        source = self._usage if compact else None
        return write_shape(
            document, self._blocks, self._loose, shape, morph=morph, source=source, provenance=provenance
        )


def _unpack(archive: Archive, limits: Limits) -> bytes:
    """Return the asset of a ZIP, with the files that it refers to, as a GLB."""
    data = archive.files[archive.main]
    kind = asset_format(data, archive.main)
    if kind == "zip":
        raise AssetFormatError(f"{archive.main} is a ZIP within a ZIP.", advice="Unpack it, and pack the files once.")
    if kind in {"glb", "gltf"}:
        return pack_gltf(archive, limits)
    from meshdeform.assets.convert import convert_to_glb

    return convert_to_glb(data, kind, limits, archive)


def load_asset(data: bytes, filename: str = "", limits: Limits | None = None) -> Asset:
    """Read an asset.

    Parameters
    ----------
    data : bytes
        A GLB, a glTF JSON with embedded buffers, an OBJ, PLY or STL, or a ZIP of one of them and the files that it
        refers to.
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
    if kind == "zip":
        source = data = _unpack(open_archive(data, limits), limits)
    elif kind not in {"glb", "gltf"}:
        from meshdeform.assets.convert import convert_to_glb

        source = data = convert_to_glb(data, kind, limits)
    document = Document.parse(data, limits, glb=data.startswith(GLB_MAGIC))
    summary = check_document(document.root, document.binary_length, limits, kind)
    usage = Usage.of(document.root, document.binary_length)
    decode_meshopt(document)
    decode_draco(document)
    return Asset(document, summary, source, usage)
