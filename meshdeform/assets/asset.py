"""Load an asset, expose its surface in world space, and write a new shape back into it."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.archive import MODEL_3MF, Archive, open_archive
from meshdeform.assets.build import Converted, Up
from meshdeform.assets.bundle import pack_gltf
from meshdeform.assets.companions import read_companions
from meshdeform.assets.compressed import decode_draco, decode_meshopt
from meshdeform.assets.container import GLB_MAGIC
from meshdeform.assets.corners import corner_colors, corner_weights
from meshdeform.assets.directions import rebuild_directions
from meshdeform.assets.document import Document
from meshdeform.assets.inspect import ZIPS, AssetSummary, asset_format, check_document
from meshdeform.assets.limits import Limits
from meshdeform.assets.morph import ANIMATION_NAME, MorphTarget, NewTargets, WeightTrack, straight
from meshdeform.assets.notices import coarseness_warnings, find_backdrop, rounding_warnings, up_axis_warnings
from meshdeform.assets.rig import NodeMove, RigMotion, joint_moves, joint_shares
from meshdeform.assets.surface import Block, Surface, block_primitives, read_surface
from meshdeform.assets.surface_pieces import Rig, SurfacePieces, read_pieces, read_rig, rig_accessors, turned_nodes
from meshdeform.assets.unchecked import member_of
from meshdeform.assets.usage import Usage
from meshdeform.assets.writer import Finish, ShapeChange, embed_data_uris, write_shape, write_targets
from meshdeform.errors import AssetFormatError

if TYPE_CHECKING:
    from meshdeform.assets.pose import Pose
    from meshdeform.assets.subdivide import Subdivision
    from meshdeform.geometry.appearance import Appearance


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
    excluded : frozenset of int
        Nodes whose meshes do not belong to the surface.
    backdrop : Backdrop, optional
        Planes that make everything else small.
    unit, up : float, str, optional
        Metres of its unit, and the axis that points up, `y` or `z`; None where the format of its file, or of the one in
        a ZIP, leaves that open.
    """

    def __init__(
        self,
        document: Document,
        summary: AssetSummary,
        source: bytes,
        usage: Usage,
        excluded: frozenset[int] = frozenset(),
        *,
        unit: float | None = 1.0,
        up: Up | None = "y",
    ) -> None:
        self._document = document
        self._read_summary = summary
        self.excluded = excluded
        self.unit, self.up = unit, up
        self.repairs = rebuild_directions(document)
        self._source = source
        self._usage = usage
        self.surface: Surface
        self._blocks: list[Block]
        self.surface, self._blocks, self._loose = read_surface(document, excluded)
        self._companions, unread = read_companions(document, self.surface, excluded)
        self.backdrop = find_backdrop(document, self.surface, self._blocks)
        backdrops = () if self.backdrop is None else (self.backdrop.warning,)
        pieces = self.pieces()
        triangles_drawn = self.surface.triangles
        if self.backdrop is not None and self.backdrop.left:
            triangles_drawn = triangles_drawn[~self.backdrop.triangles]
        shape = self.surface.positions, triangles_drawn
        rounded = rounding_warnings(self.surface, self._blocks)
        notices = (*backdrops, *up_axis_warnings(*shape), *coarseness_warnings(*shape), *rounded)
        self.summary = dataclasses.replace(
            summary,
            nodes=tuple(pieces.nodes),
            materials=tuple(pieces.materials),
            mesh_names=tuple(pieces.meshes),
            joints=tuple(pieces.joints),
            vertices=len(self.surface.positions),
            triangles=len(self.surface.triangles),
            bounds=_bounds(self.surface.positions[triangles_drawn]),
            skipped=tuple(self.surface.skipped),
            warnings=(*summary.warnings, *self.repairs.warnings, *unread, *notices),
        )

    def to_bytes(self) -> bytes:
        """Return the unchanged asset as a GLB: the loaded bytes themselves if they were a GLB."""
        if self._source.startswith(GLB_MAGIC):
            return self._source
        document = self._document.fork()
        embed_data_uris(document)
        return document.to_bytes()

    def document(self) -> Document:
        """Return the glTF document, to read or to edit: a copy."""
        return self._document.fork()

    def baked(self, pose: Pose | None = None) -> tuple[Document, list[str]]:
        """Return a copy of the document in a pose, without its rig, and what is lost in sentences (`assets/bake.py`).

        `pose`: None is that of the nodes. Raises ParameterError: there is no such clip, or it has no such time.
        """
        from meshdeform.assets.bake import bake

        document = self._document.fork()
        return document, bake(document, pose)

    def packed(self, document: Document) -> bytes:
        """Write a changed copy of the document as a GLB, without the data that became unused."""
        from meshdeform.assets.compact import compact

        embed_data_uris(document)
        compact(document, self._usage, [])
        return document.to_bytes()

    def appearance(self) -> Appearance:
        """Read how the surface looks, for drawing it; needs Pillow. What cannot be read is replaced and counted."""
        from meshdeform.assets.appearance import read_appearance

        return read_appearance(self._document, self._blocks)

    def pieces(self) -> SurfacePieces:
        """List the nodes, meshes, materials and joints of the surface, and which triangles belong to each."""
        return read_pieces(self._document, self._blocks)

    def polygons(self) -> list[dict[str, Any]]:
        """List the polygons that the triangles of each primitive were cut from, where they were."""
        return [
            {"node": block.node, "primitive": number, "runs": runs}
            for block, number, primitive, _ in block_primitives(self._document.root, self._blocks)
            if isinstance(runs := member_of(primitive, "extras").get("polygons"), list)
        ]

    def joint_weights(self, joints: Collection[int]) -> NDArray[np.float64]:
        """Return how much each corner (T, 3) of the surface's triangles follows these joints, 0 to 1."""
        return corner_weights(self._document, self._blocks, joints)

    def joint_shares(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Return rows of the surface, the nodes of joints, and how much the ones follow the others, (K,) each.

        A mesh without a skin on or below a joint follows it.
        """
        return joint_shares(self._document, self._blocks)

    def vertex_colors(self) -> NDArray[np.float64]:
        """Return the linear vertex colour (T, 3, 3) of each corner of the triangles; NaN where there is none."""
        return corner_colors(self._document, self._blocks)

    def texture_coordinates(self) -> dict[str, str]:
        """Return the SHA-256 of each decoded texture coordinate set by its user, to prove UVs unchanged."""
        names: dict[str, str] = {}
        for number, block in enumerate(self._blocks):
            for p in block.primitives:
                attributes = self._document.root["meshes"][block.mesh]["primitives"][p]["attributes"]
                for name in sorted(a for a in attributes if a.startswith("TEXCOORD_")):
                    values = read_floats(self._document, attributes[name])
                    names[f"{number}/{p}/{name}"] = hashlib.sha256(values.tobytes()).hexdigest()
        return names

    def rig(self) -> Rig:
        """Count the morph targets, joints and animations that would have to follow the surface."""
        return read_rig(self._document, self._blocks)

    def joint_moves(
        self, positions: NDArray[np.float64], jacobians: NDArray[np.float64]
    ) -> dict[int, tuple[str, NodeMove]]:
        """Return by node the name of each joint and how it moves with a new shape, given as to `replace`."""
        motion = RigMotion(self.surface.positions, positions - self.surface.positions, jacobians)
        nodes = self._document.root.get("nodes", [])
        moves = joint_moves(self._document, self._blocks, motion)
        return {joint: (str(nodes[joint].get("name", "")), move) for joint, move in moves.items()}

    def turned_nodes(self) -> list[str]:
        """Return the names of nodes with meshes of the surface that animations turn or scale, joints apart."""
        return turned_nodes(self._document, self._blocks)

    def rig_digest(self) -> str:
        """Return the SHA-256 of what may follow a shape: the surface's morph targets and rig, and nodes' origins."""
        digest = hashlib.sha256()
        for node in self._document.root.get("nodes", []):
            digest.update(repr(node["matrix"][12:15] if "matrix" in node else node.get("translation")).encode())
        for accessor in rig_accessors(self._document, self._blocks):
            digest.update(read_floats(self._document, accessor).tobytes())
        return digest.hexdigest()

    def without(self, nodes: Collection[int]) -> Asset:
        """Return the asset without these nodes and those below them: they stay in the file as they are.

        Raises
        ------
        AssetEmptyError
            Nothing is left.
        """
        if not nodes:
            return self
        below = list(nodes)
        for at in below:  # grows while it is read; nodes form a forest
            below += self._document.root["nodes"][at].get("children", [])
        excluded = self.excluded | frozenset(below)
        copy = Asset(self._document.fork(), self._read_summary, self._source, self._usage, excluded)
        return copy._as_repaired(self)

    def _as_repaired(self, source: Asset) -> Asset:
        """Take over what was repaired and found out when the source was read."""
        self.repairs, self.unit, self.up = source.repairs, source.unit, source.up
        warnings = (*self.summary.warnings, *source.repairs.warnings)
        self.summary = dataclasses.replace(self.summary, format=source.summary.format, warnings=warnings)
        return self

    def subdivided(self, max_triangles: int) -> tuple[Asset, Subdivision]:
        """Return the asset with its long edges split, and what was split.

        Parameters
        ----------
        max_triangles : int
            Number of triangles, over all instances, that the result does not exceed.

        Returns
        -------
        The asset itself if no edge is long. Otherwise one with other vertices and triangles, in which nodes,
        primitives, materials and everything else keep their indices.

        Raises
        ------
        AssetError
            An attribute has another number of elements than its positions.
        """
        from meshdeform.assets.subdivide import subdivide

        document = self._document.fork()
        done = subdivide(document, max_triangles, self.excluded)
        if not done.split:
            return self, done
        finer = load_asset(self.packed(document), limits=Limits.unlimited()).without(self.excluded)
        return finer._as_repaired(self), done

    def replace(
        self,
        positions: NDArray[np.float64],
        normals: NDArray[np.float64] | None = None,
        tangents: NDArray[np.float64] | None = None,
        *,
        jacobians: NDArray[np.float64] | None = None,
        joints: Mapping[int, NodeMove] | None = None,
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
        jacobians : (N, 3, 3) float64, optional
            The linear map of the deformation around each vertex, in world space. With it, the file's morph targets,
            joints and other nodes follow the shape (`assets/writer.py`, `assets/attached.py`); not with `morph`.
        joints : mapping of int to NodeMove, optional
            How joints do. Default: as `joint_moves` returns.
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
        if morph:
            target = MorphTarget(ANIMATION_NAME, positions, normals, tangents)
            return self.morph([target], track=straight(), compact=compact, provenance=provenance)
        shape = ShapeChange.checked(self.surface, positions, normals, tangents, jacobians, joints)
        finish = Finish(self._usage if compact else None, provenance)
        return write_shape(self._document.fork(), self._blocks, self._loose, shape, finish, self._companions)

    def morph(
        self,
        targets: Sequence[MorphTarget],
        *,
        weights: Sequence[float] | None = None,
        track: WeightTrack | None = None,
        compact: bool = False,
        provenance: Mapping[str, Any] | None = None,
    ) -> bytes:
        """Write the asset with shapes as morph targets after those that it has.

        Parameters
        ----------
        weights : sequence of float, optional
            What the file shows at rest. Default: the last target.
        track : WeightTrack, optional
            An animation of the targets.
        compact, provenance
            As for `replace`.

        Returns
        -------
        A GLB. The asset itself is not changed.

        Raises
        ------
        NumericalError, ShapeError
            As for `replace`.
        """
        shapes = [ShapeChange.checked(self.surface, t.positions, t.normals, t.tangents) for t in targets]
        rest = [*[0.0] * (len(targets) - 1), 1.0] if weights is None else list(weights)
        new = NewTargets([target.name for target in targets], rest, track)
        finish = Finish(self._usage if compact else None, provenance)
        return write_targets(self._document.fork(), self._blocks, self._loose, shapes, new, finish)

    @property
    def provenance(self) -> dict[str, Any] | None:
        """The provenance that `output.provenance` stored in the file; None if there is none."""
        provenance = member_of(self._document.root, "asset", "extras").get("meshdeform")
        return provenance if isinstance(provenance, dict) else None


def _unpack(archive: Archive, limits: Limits) -> Converted:
    """Return the asset of a ZIP, with the files that it refers to."""
    data = archive.files[archive.main]
    kind = "3mf" if archive.main.lower().endswith(MODEL_3MF) else asset_format(data, archive.main)
    if kind in ZIPS - {"3mf"}:
        raise AssetFormatError(f"{archive.main} is a ZIP within a ZIP.", advice="Unpack it, and pack the files once.")
    if kind in {"glb", "gltf"}:
        return Converted(pack_gltf(archive, limits), archive.notices(), 1.0, "y")
    from meshdeform.assets.convert import convert_to_glb

    converted = convert_to_glb(data, kind, limits, archive)
    return dataclasses.replace(converted, notices=(*converted.notices, *archive.notices()))


def _bounds(corners: NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    """Return the least and the greatest coordinates of triangles (T, 3, 3); empty if there are none."""
    if not len(corners):
        return ()
    return tuple(corners.min((0, 1)).tolist()), tuple(corners.max((0, 1)).tolist())


def load_asset(data: bytes, filename: str = "", limits: Limits | None = None) -> Asset:
    """Read an asset.

    Parameters
    ----------
    data : bytes
        A GLB, a glTF JSON with embedded buffers, an OBJ, PLY, STL or 3MF, or a ZIP of one of them and the files that
        it refers to.
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
    limits.check_bytes(len(data))
    kind = asset_format(data, filename)
    read = Converted(data, (), 1.0, "y")
    if kind in ZIPS:
        read = _unpack(open_archive(data, limits), limits)
    elif kind not in {"glb", "gltf"}:
        from meshdeform.assets.convert import convert_to_glb

        read = convert_to_glb(data, kind, limits, Archive(filename or f"asset.{kind}", {}))
    data = read.glb
    document = Document.parse(data, limits, glb=data.startswith(GLB_MAGIC))
    summary = check_document(document.root, document.binary_length, limits, kind)
    usage = Usage.of(document.root, document.binary_length)
    decode_meshopt(document)
    decode_draco(document)
    summary = dataclasses.replace(summary, warnings=(*summary.warnings, *read.notices))
    return Asset(document, summary, data, usage, unit=read.unit, up=read.up)
