"""Inspect an asset from its JSON alone: the first check, before anything is decoded. Pure Python.

No allocation depends on a size that the file merely declares. `meshdeform.assets.check` runs this, and decodes the
rest, in a child process.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from meshdeform.assets.archive import ZIP_MAGIC, inspect_archive, listed
from meshdeform.assets.codes import GPU_INSTANCING, TRIANGLES, VISIBILITY
from meshdeform.assets.container import GLB_MAGIC, Data, Json, glb_layout, indices, member, objects, parse_json, text
from meshdeform.assets.extensions import notices, rule_of
from meshdeform.assets.limits import Limits
from meshdeform.assets.other_formats import CONVERTERS, inspect_foreign, no_triangles, refuse_other_format
from meshdeform.assets.scene_checks import (
    Instance,
    check_geometry,
    check_meshes,
    check_nodes,
    instance_count,
    nodes_below,
    shown_and_hidden,
)
from meshdeform.assets.storage_checks import check_storage, outside_images
from meshdeform.errors import AssetEmptyError, AssetError, AssetFormatError, AssetTooLargeError, AssetUnsupportedError

LOOSE = "points and lines only follow a surface"
"""Why a file of nothing but points and lines is refused."""
# A link with a scheme or a drive, from the root, or to another host, in place of a file beside the asset.
_ELSEWHERE = re.compile(r"\s*([a-z][a-z0-9+.-]*:|[/\\]|%2f|%5c)", re.IGNORECASE)
FORMATS = frozenset({"glb", "gltf", "obj", "ply", "stl", "zip", "3mf", *CONVERTERS})
"""File extensions that `asset_format` distinguishes."""

ZIPS = frozenset({"zip", "3mf"})
SURFACES = {"xyz": "points", "npz": "grid", "safetensors": "network"}
"""Surfaces without triangles by their file extensions; points may also be in a PLY."""


def check_extensions(root: Json) -> None:
    """Refuse an asset that requires an unknown extension, which might change the geometry.

    Raises AssetUnsupportedError: the message names the extension.
    """
    required = root.get("extensionsRequired", [])
    if not isinstance(required, list) or not all(isinstance(name, str) for name in required):
        raise AssetError("extensionsRequired must be an array of names.")
    for name in required:
        rule = rule_of(name)
        if rule is None or rule.refused:
            reason = f": {rule.refused}" if rule else ""
            raise AssetUnsupportedError(f"The asset requires the extension {name[:100]!r}{reason}.")


@dataclass(frozen=True)
class PictureSummary:
    """Content of a picture."""

    format: str  # `png`, `jpeg` or `webp`
    # Pixels
    width: int
    height: int
    box: tuple[float, float, float, float]
    """Left, top, right and bottom of the silhouette as shares of the width and height."""
    share: float  # share of the picture that the silhouette covers

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Self:
        """Return a summary from its JSON."""
        return cls(**{**document, "box": tuple(document["box"])})


@dataclass(frozen=True)
class AssetSummary:
    """The size and contents of an asset.

    `format`: `glb`, `gltf`, `obj`, `ply`, `stl`, `3mf` or `zip`. `vertices` and `triangles`: counts in the default
    scene, over all instances. For OBJ, PLY and STL an estimate until the file is decoded, and 0 for ZIP and 3MF.
    `meshes`: number of mesh instances in the default scene; `extensions`: `extensionsUsed`; `skipped`: primitives that
    are not deformed, and why; `warnings`: sentences about anything in the file that may surprise or get in the way.
    `nodes`, `materials`, `mesh_names` and `joints`: `index` and `name` of each node, material, mesh and joint that is
    deformed (`assets.surface_pieces`); empty until the file is decoded. `bounds`: least and greatest coordinates of
    what is drawn, (2, 3), in the file's world; empty until the file is decoded.
    """

    format: str
    vertices: int
    triangles: int
    meshes: int = 1
    extensions: tuple[str, ...] = ()
    skipped: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    nodes: tuple[dict[str, Any], ...] = ()
    materials: tuple[dict[str, Any], ...] = ()
    mesh_names: tuple[dict[str, Any], ...] = ()
    joints: tuple[dict[str, Any], ...] = ()
    bounds: tuple[tuple[float, ...], ...] = ()


def inspect_asset(data: Data, filename: str = "", limits: Limits | None = None) -> AssetSummary:
    """Check an asset without decoding it.

    `data`: the file. `filename`: its name. The extension decides the format where the content does not. `limits`: upper
    bounds on the asset. Raises AssetError: the asset cannot be used; the subclass and message say why and what to do.
    """
    limits = limits or Limits()
    limits.check_bytes(len(data))
    kind = asset_format(data, filename)
    if kind in ZIPS:
        inspect_archive(data, limits)
        return AssetSummary(kind, 0, 0)
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

    Raises AssetFormatError: neither indicates glTF, OBJ, PLY, STL or ZIP. Raises AssetEmptyError: it is a surface
    without triangles.
    """
    head = bytes(data[:64])
    ending = filename.lower().rpartition(".")[2] if "." in filename else ""
    if head.startswith(GLB_MAGIC):
        return "glb"
    if head.startswith((b"ply\n", b"ply\r")):
        return "ply"
    refuse_other_format(head, ending)
    if ending in SURFACES:  # an NPZ is a ZIP
        raise no_triangles(SURFACES[ending])
    if head.startswith(ZIP_MAGIC):
        return "3mf" if ending == "3mf" else "zip"
    if ending == "gltf" or (not ending and head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")):
        return "gltf"
    if ending in {"obj", "stl"} and head:
        return ending
    if ending in {"glb", "ply", "zip", "3mf"}:
        raise AssetFormatError(f"The file is named .{ending}, but its content is something else.")
    raise AssetFormatError("The file is neither glTF (.glb), an OBJ, PLY or STL mesh, a 3MF, nor a ZIP of one.")


def surface_format(head: bytes, filename: str) -> str | None:
    """Return `points`, `grid` or `network` if a file may be one of these; None for a mesh.

    `head`: the first 64 KiB.
    """
    ending = filename.lower().rpartition(".")[2] if "." in filename else ""
    if ending in SURFACES:
        return SURFACES[ending]
    if head.startswith((b"ply\n", b"ply\r")):
        header = head.partition(b"end_header")[0]
        counts = [
            line.split()[2:3] for line in header.splitlines() if line.startswith((b"element face", b"element trist"))
        ]
        return "points" if all(count == [b"0"] for count in counts) else None
    return None


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
    member(root, "extensions", "the document")
    for key in ("nodes", "scenes", "meshes"):
        for i, holder in enumerate(objects(root, key)):
            member(holder, "extensions", f"{key}[{i}]")
    check_extensions(root)
    check_storage(root, binary_length, limits, *check_meshes(root))
    check_nodes(root)
    check_geometry(root)
    objects(root, "animations")  # not read, but one may be appended
    return _summary(root, limits, kind, tuple(used))


def _summary(root: Json, limits: Limits, kind: str, extensions: tuple[str, ...]) -> AssetSummary:
    vertices = triangles = meshes = primitives = 0
    skipped: list[dict[str, Any]] = []
    drawn: list[int] = []
    loose = 0
    accessors = objects(root, "accessors")
    per_mesh = [_mesh_counts(mesh, accessors) for mesh in objects(root, "meshes")]
    costs = [_cost(mesh) for mesh in objects(root, "meshes")]
    shown, hidden = shown_and_hidden(root)
    for instance in shown:
        primitives += costs[instance.mesh]
        if primitives > limits.max_primitives:
            raise AssetTooLargeError(
                f"The scene has more than {limits.max_primitives} primitives and morph targets "
                "(each instance of a mesh counts).",
                advice="Join meshes of the same material, or leave instances out.",
            )
        count = instance_count(root, instance.node)
        if count is not None:
            drawn.append(count)
        mesh_vertices, mesh_triangles, mesh_loose, mesh_skipped = per_mesh[instance.mesh]
        loose += mesh_loose
        vertices, triangles, meshes = vertices + mesh_vertices, triangles + mesh_triangles, meshes + 1
        skipped += [{"node": instance.node, "mesh": instance.mesh, **item} for item in mesh_skipped]
        if triangles > limits.max_triangles or vertices + loose > limits.max_vertices:
            raise AssetTooLargeError(
                f"The scene has more than {limits.max_triangles} triangles or {limits.max_vertices} vertices "
                "(MESHDEFORM_MAX_TRIANGLES; each instance of a mesh counts)."
            )
    if triangles == 0:
        raise _empty(root, [*skipped, *([{"reason": LOOSE}] if loose else [])], primitives > 0, bool(hidden))
    outside = outside_images(root)
    foreign = [link for link in outside if _ELSEWHERE.match(link)]
    beside = [link for link in outside if link not in foreign]
    warnings = (
        *([_instancing_notice(drawn)] if drawn else []),
        *([_images_beside_notice(beside)] if beside else []),
        *([_foreign_images_notice(foreign)] if foreign else []),
        *([_hidden_notice(root, hidden)] if hidden else []),
        *_scenes_notice(root, shown),
        *notices(root),
    )
    return AssetSummary(kind, vertices, triangles, meshes, extensions, tuple(skipped), warnings)


def _scenes_notice(root: Json, shown: list[Instance]) -> list[str]:
    """Return a sentence about scenes that are not deformed, if they show other meshes."""
    scenes = objects(root, "scenes")
    known = {instance.node for instance in shown}
    others = {
        node
        for scene in scenes
        for node in nodes_below(root, indices(scene, "nodes", len(objects(root, "nodes")), "scene"))
        if "mesh" in root["nodes"][node]
    } - known
    if len(scenes) < 2 or not (others or "scene" not in root):
        return []
    default = "" if "scene" in root else " The file names none as its default, so the first one is meant."
    return [f"The file has {len(scenes)} scenes, of which one is deformed; the others stay as they are.{default}"]


def _foreign_images_notice(links: list[str]) -> str:
    names = ", ".join(repr(link[:60]) for link in links[:3]) + (" ..." if len(links) > 3 else "")
    return (
        f"Images at other places ({names}) stay links in the result: a program that opens it may fetch them, with the "
        "rights of whoever opens it. Take out links that you do not know."
    )


def _images_beside_notice(links: list[str]) -> str:
    return (
        f"Images in other files ({listed(links)}) stay links in the result, and pictures show them grey. To pack them "
        "in, send the asset and these files as a ZIP."
    )


def _hidden_notice(root: Json, hidden: list[Instance]) -> str:
    nodes = [root["nodes"][instance.node].get("name") or f"node {instance.node}" for instance in hidden]
    names = listed([str(name) for name in nodes])
    return f"{VISIBILITY} hides {names}: what is hidden is neither drawn nor deformed, and stays in the file as it is."


def _instancing_notice(counts: list[int]) -> str:
    meshes = "1 mesh" if len(counts) == 1 else f"{len(counts)} meshes"
    return (
        f"{GPU_INSTANCING} draws {meshes} {sum(counts)} times. Each is deformed once, in the place of its first "
        "instance, and all its instances get the new shape."
    )


def _empty(root: Json, skipped: list[dict[str, Any]], has_meshes: bool, hidden: bool) -> AssetEmptyError:
    """Return the error of an asset without triangles, with advice that fits the reason."""
    if has_meshes:
        reasons = "; ".join(sorted({item["reason"] for item in skipped})[:5])
        return AssetEmptyError("The default scene shows no triangles" + (f": {reasons}." if reasons else "."))
    meshes = len(objects(root, "meshes"))
    if not meshes:
        return AssetEmptyError("The file contains no mesh.", advice="Export the objects as meshes.")
    count = "1 mesh" if meshes == 1 else f"{meshes} meshes"
    if not any("mesh" in node for node in objects(root, "nodes")):
        return AssetEmptyError(
            f"The file contains {count}, but no node shows a mesh.",
            advice="Export the objects together with the scene that they are in.",
        )
    if hidden:
        return AssetEmptyError(
            f"{VISIBILITY} hides every mesh of the default scene.", advice="Make the nodes visible, and export again."
        )
    return AssetEmptyError(
        f"The default scene shows no mesh; the file contains {count}.",
        advice="Add the nodes with meshes to the default scene, or name their scene in `scene`, and export again.",
    )


def _cost(mesh: Json) -> int:
    """Return the cost of one instance of a mesh; every primitive gets as many targets as the one with the most."""
    primitives = objects(mesh, "primitives")
    targets = max((len(primitive.get("targets", [])) for primitive in primitives), default=0)
    return max(1, len(primitives) * (1 + targets), len(mesh.get("weights", [])))


def _mesh_counts(mesh: Json, accessors: list[Json]) -> tuple[int, int, int, list[dict[str, Any]]]:
    """Return a mesh's vertices (each set of accessors once), triangles, loose vertices, and the skipped primitives."""
    # Loose vertices are those of points and lines.
    blocks: dict[tuple[int | None, ...], int] = {}
    triangles, skipped, loose = 0, [], dict[int, int]()
    for p, primitive in enumerate(objects(mesh, "primitives")):
        attributes, mode = primitive.get("attributes", {}), primitive.get("mode", TRIANGLES)
        if mode < TRIANGLES:
            if "POSITION" in attributes:
                loose[attributes["POSITION"]] = accessors[attributes["POSITION"]]["count"]
            continue
        if "POSITION" not in attributes:
            skipped.append({"primitive": p, "reason": "no POSITION attribute"})
            continue
        block = tuple(attributes.get(name) for name in ("POSITION", "NORMAL", "TANGENT"))
        blocks[block] = count = accessors[attributes["POSITION"]]["count"]
        corners = accessors[primitive["indices"]]["count"] if "indices" in primitive else count
        triangles += corners // 3 if mode == TRIANGLES else max(corners - 2, 0)
    return sum(blocks.values()), triangles, sum(loose.values()), skipped
