"""Inspect an asset from its JSON alone: the first check, before anything is decoded. Pure Python.

No allocation depends on a size that the file merely declares. `meshdeform.assets.check` runs this, and decodes the
rest, in a child process.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from meshdeform.assets.container import GLB_MAGIC, Data, glb_layout
from meshdeform.assets.fields import member, objects, text
from meshdeform.assets.json_text import Json, parse_json
from meshdeform.assets.limits import Limits
from meshdeform.assets.other_formats import inspect_foreign
from meshdeform.assets.scenegraph import (
    GPU_INSTANCING,
    MODE_NAMES,
    POINTS,
    TRIANGLES,
    check_extensions,
    check_geometry,
    check_meshes,
    check_nodes,
    instances_of,
)
from meshdeform.assets.storage import check_storage
from meshdeform.errors import AssetEmptyError, AssetError, AssetFormatError, AssetTooLargeError, AssetUnsupportedError

__all__ = ["FORMATS", "AssetSummary", "asset_format", "check_document", "inspect_asset"]

FORMATS = frozenset({"glb", "gltf", "obj", "ply", "stl"})


@dataclass(frozen=True)
class AssetSummary:
    """The size and contents of an asset.

    Attributes
    ----------
    format : str
        `glb`, `gltf`, `obj`, `ply` or `stl`.
    vertices, triangles : int
        Counts in the default scene, over all instances. For OBJ, PLY and STL an estimate until the file is decoded.
    meshes : int
        Number of mesh instances in the default scene.
    extensions : tuple of str
        `extensionsUsed`.
    skipped : tuple of dict
        Parts that are not deformed, and why.
    nodes, materials : tuple of dict
        `index` and `name` of each node and material that is deformed (`assets.parts`); empty until the file is decoded.
    warnings : tuple of str
        Sentences about what limits the result, with the remedy; empty until the file is decoded.
    """

    format: str
    vertices: int
    triangles: int
    meshes: int = 1
    extensions: tuple[str, ...] = ()
    skipped: tuple[dict[str, Any], ...] = ()
    nodes: tuple[dict[str, Any], ...] = ()
    materials: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()


def inspect_asset(data: Data, filename: str = "", limits: Limits | None = None) -> AssetSummary:
    """Check an asset without decoding it.

    Parameters
    ----------
    data : bytes or mmap
        The file.
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
    if kind not in {"glb", "gltf"}:
        vertices, triangles = inspect_foreign(data, kind, limits)
        return AssetSummary(kind, vertices, triangles)
    binary: slice | None = None
    if kind == "glb":
        layout = glb_layout(data, limits)
        root, binary = parse_json(bytes(data[layout.json]), limits), layout.binary
    else:
        root = parse_json(bytes(data), limits)
    return check_document(root, None if binary is None else binary.stop - binary.start, limits, kind)


def asset_format(data: Data, filename: str) -> str:
    """Return the format according to the first bytes, else to the file's name.

    Raises
    ------
    AssetFormatError
        Neither indicates glTF, OBJ, PLY or STL.
    """
    head = bytes(data[:64])
    ending = filename.lower().rpartition(".")[2] if "." in filename else ""
    if head.startswith(GLB_MAGIC):
        return "glb"
    if head.startswith((b"ply\n", b"ply\r")):
        return "ply"
    if ending == "gltf" or (not ending and head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")):
        return "gltf"
    if ending in {"obj", "stl"} and head:
        return ending
    if ending in {"glb", "ply"}:
        raise AssetFormatError(f"The file is named .{ending}, but its content is something else.")
    raise AssetFormatError("The file is neither glTF (.glb) nor an OBJ, PLY or STL mesh.")


def check_document(root: Json, binary_length: int | None, limits: Limits, kind: str) -> AssetSummary:
    """Check a parsed glTF document and return its summary."""
    asset = member(root, "asset", "the document")
    version = text(asset, "version", "asset") or ""
    if not version.startswith("2."):
        raise AssetFormatError(
            f"The asset has glTF version {version[:20]!r}; only 2.0 is supported.",
            advice="Export it again as glTF 2.0.",
        )
    minimum = text(asset, "minVersion", "asset")
    if minimum is not None and minimum != "2.0":
        raise AssetUnsupportedError(f"The asset needs glTF {minimum[:20]!r}.", advice="Export it again as glTF 2.0.")
    used = root.get("extensionsUsed", [])
    if not isinstance(used, list) or not all(isinstance(name, str) for name in used):
        raise AssetError("extensionsUsed must be an array of names.")
    check_extensions(root)
    check_storage(root, binary_length, limits, *check_meshes(root))
    check_nodes(root)
    check_geometry(root)
    objects(root, "animations")  # not read, but one may be appended
    return _summary(root, limits, kind, tuple(used))


def _summary(root: Json, limits: Limits, kind: str, extensions: tuple[str, ...]) -> AssetSummary:
    vertices = triangles = meshes = primitives = 0
    skipped: list[dict[str, Any]] = []
    accessors = objects(root, "accessors")
    per_mesh = [_mesh_counts(mesh, accessors) for mesh in objects(root, "meshes")]
    weights = [_weight(mesh) for mesh in objects(root, "meshes")]
    for instance in instances_of(root):
        primitives += weights[instance.mesh]
        if primitives > limits.max_primitives:
            raise AssetTooLargeError(
                f"The scene has more than {limits.max_primitives} primitives and morph targets "
                "(each instance of a mesh counts).",
                advice="Join meshes of the same material, or leave instances out.",
            )
        if GPU_INSTANCING in root["nodes"][instance.node].get("extensions", {}):
            skipped.append({"node": instance.node, "reason": f"{GPU_INSTANCING} draws its mesh many times"})
            continue
        mesh_vertices, mesh_triangles, mesh_skipped = per_mesh[instance.mesh]
        vertices, triangles, meshes = vertices + mesh_vertices, triangles + mesh_triangles, meshes + 1
        skipped += [{"node": instance.node, "mesh": instance.mesh, **item} for item in mesh_skipped]
        if triangles > limits.max_triangles or vertices > limits.max_vertices:
            raise AssetTooLargeError(
                f"The scene has more than {limits.max_triangles} triangles or {limits.max_vertices} vertices "
                "(MESHDEFORM_MAX_TRIANGLES; each instance of a mesh counts)."
            )
    if triangles == 0:
        raise _empty(skipped, primitives > 0)
    return AssetSummary(kind, vertices, triangles, meshes, extensions, tuple(skipped))


def _empty(skipped: list[dict[str, Any]], has_meshes: bool) -> AssetEmptyError:
    """Return the error of an asset without triangles, with advice that fits the reason."""
    if not has_meshes:
        return AssetEmptyError(
            "The default scene shows no mesh.",
            advice="Add the nodes with meshes to the default scene, and export again.",
        )
    reasons = "; ".join(sorted({item["reason"] for item in skipped})[:5])
    advice = "Turn the instances into meshes of their own, and export again." if GPU_INSTANCING in reasons else None
    return AssetEmptyError(
        "The default scene shows no triangles" + (f": {reasons}." if reasons else "."), advice=advice
    )


def _weight(mesh: Json) -> int:
    """Return the cost of one instance of a mesh; every primitive gets as many targets as the one with the most."""
    primitives = objects(mesh, "primitives")
    targets = max((len(primitive.get("targets", [])) for primitive in primitives), default=0)
    return max(1, len(primitives) * (1 + targets), len(mesh.get("weights", [])))


def _mesh_counts(mesh: Json, accessors: list[Json]) -> tuple[int, int, list[dict[str, Any]]]:
    """Return a mesh's vertices (counting each set of accessors once), its triangles, and the skipped primitives."""
    blocks: dict[tuple[int | None, ...], int] = {}
    triangles, skipped = 0, []
    for p, primitive in enumerate(objects(mesh, "primitives")):
        attributes, mode = primitive.get("attributes", {}), primitive.get("mode", TRIANGLES)
        if POINTS <= mode < TRIANGLES:
            skipped.append({"primitive": p, "reason": f"{MODE_NAMES[mode]} are not deformed"})
            continue
        if "POSITION" not in attributes:
            skipped.append({"primitive": p, "reason": "no POSITION attribute"})
            continue
        block = tuple(attributes.get(name) for name in ("POSITION", "NORMAL", "TANGENT"))
        blocks[block] = count = accessors[attributes["POSITION"]]["count"]
        corners = accessors[primitive["indices"]]["count"] if "indices" in primitive else count
        triangles += corners // 3 if mode == TRIANGLES else max(corners - 2, 0)
    return sum(blocks.values()), triangles, skipped
