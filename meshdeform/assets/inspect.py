"""Inspect an asset from its JSON alone: the first check, before anything is decoded. Pure Python.

No allocation depends on a size that the file merely declares. `meshdeform.assets.check` runs this, and decodes the
rest, in a child process. Buffers, buffer views and accessors must fit the data in the file; nodes, scenes, meshes and
skins are checked, and the mesh instances of the default scene listed.

Source: glTF 2.0 specification, sections 3.5 (Scenes), 3.6, 3.7 (Geometry) and 5.1 to 5.6.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from meshdeform.assets.archive import ZIP_MAGIC, inspect_archive, listed
from meshdeform.assets.container import (
    GLB_MAGIC,
    Data,
    Json,
    extension,
    glb_layout,
    index,
    indices,
    integer,
    member,
    numbers,
    objects,
    parse_json,
    text,
)
from meshdeform.assets.extensions import notices, rule_of
from meshdeform.assets.limits import Limits
from meshdeform.assets.other_formats import CONVERTERS, inspect_foreign, no_triangles, refuse_other_format
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetExternalError,
    AssetFormatError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
)

BYTE, UNSIGNED_BYTE, SHORT, UNSIGNED_SHORT, UNSIGNED_INT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
COMPONENT_BYTES = {BYTE: 1, UNSIGNED_BYTE: 1, SHORT: 2, UNSIGNED_SHORT: 2, UNSIGNED_INT: 4, FLOAT: 4}
TYPE_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MESHOPT_EXTENSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_FILTER_STRIDES = {
    "NONE": range(1, 257),
    "OCTAHEDRAL": (4, 8),
    "QUATERNION": (8,),
    "EXPONENTIAL": range(4, 257, 4),
    "COLOR": (4, 8),
}
DRACO = "KHR_draco_mesh_compression"
GPU_INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
POINTS, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = 0, 4, 5, 6
LOOSE = "points and lines only follow a surface"
"""Why a file of nothing but points and lines is refused."""
# A link with a scheme or a drive, from the root, or to another host, in place of a file beside the asset.
_ELSEWHERE = re.compile(r"\s*([a-z][a-z0-9+.-]*:|[/\\]|%2f|%5c)", re.IGNORECASE)
_INSTANCE_TYPES = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
_POSITION_TYPES = (FLOAT, BYTE, UNSIGNED_BYTE, SHORT, UNSIGNED_SHORT)
FORMATS = frozenset({"glb", "gltf", "obj", "ply", "stl", "zip", "3mf", *CONVERTERS})
"""File extensions that `asset_format` distinguishes."""

ZIPS = frozenset({"zip", "3mf"})
SURFACES = {"xyz": "points", "npz": "grid", "safetensors": "network"}
"""Surfaces without triangles by their file extensions; points may also be in a PLY."""


@dataclass(frozen=True)
class CompressedView:
    """The members of a buffer view's meshopt extension."""

    buffer: int
    offset: int
    length: int
    stride: int
    count: int
    mode: str
    filter: str


def check_storage(
    root: Json, binary_length: int | None, limits: Limits, decoded_later: set[int], unread: set[int]
) -> None:
    """Check buffers, buffer views and accessors.

    `root`: the parsed JSON; `binary_length`: length of the GLB's binary chunk; `limits`: upper bounds on the asset;
    `decoded_later`: accessors that a Draco stream fills; `unread`: accessors that are never decoded. Raises
    AssetExternalError: a buffer is in another file. Raises AssetTruncatedError: a buffer, view or accessor reaches past
    its data. Raises AssetTooLargeError: a count is over its limit, or compressed data decodes to more bytes than a file
    may have. Raises AssetError: anything else is not valid.
    """
    # Check each array once; doing so for every element would take hours for a hostile file.
    views = objects(root, "bufferViews")
    for i, image in enumerate(objects(root, "images")):
        text(image, "uri", f"images[{i}]")  # a link to another file stays as it is; the deformation reads no image
        index(image, "bufferView", len(views), f"images[{i}]")
    for i, buffer in enumerate(objects(root, "buffers")):
        _check_buffer(buffer, i, binary_length)
    decoded = sum(_check_view(root, i, binary_length) for i in range(len(views)))
    for i in range(len(objects(root, "accessors"))):
        bare = _check_accessor(root, i, limits)
        if i in decoded_later:
            decoded += bare
        elif bare and i not in unread and root["accessors"][i]["count"] > limits.max_bare_elements:
            raise AssetTooLargeError(
                f"accessors[{i}] declares {root['accessors'][i]['count']} elements without data; "
                f"the limit is {limits.max_bare_elements}."
            )
    limits.check_bytes(decoded, "The compressed data decodes to")


def _refuse_external(uri: str | None, where: str) -> None:
    if uri is not None and uri[:5].lower() != "data:":
        name = uri if len(uri) <= 80 else uri[:77] + "..."
        raise AssetExternalError(f"{where} refers to another file: {name!r}.")


def outside_images(root: Json) -> list[str]:
    """Return the links of images that are in other files."""
    links = [image.get("uri", "") for image in root.get("images", [])]
    return [link for link in links if link and link[:5].lower() != "data:"]


def data_uri_bytes(uri: str) -> int:
    """Return an upper bound on the bytes of a data URI, without decoding it."""
    header, _, payload = uri.partition(",")
    return len(payload) * 3 // 4 if header.endswith(";base64") else len(payload)


def is_placeholder(root: Json, buffer: int, binary_length: int | None) -> bool:
    """Return whether a buffer has no data and serves only as the target of decoded meshopt views."""
    return "uri" not in root["buffers"][buffer] and not (buffer == 0 and binary_length is not None)


def _check_buffer(buffer: Json, i: int, binary_length: int | None) -> None:
    where = f"buffers[{i}]"
    length = integer(buffer, "byteLength", where, minimum=1)
    uri = text(buffer, "uri", where)
    _refuse_external(uri, where)
    if uri is not None:
        held = data_uri_bytes(uri)
    elif i == 0 and binary_length is not None:
        held = binary_length
    else:
        return  # a placeholder; uncompressed views into it are refused elsewhere
    if length > held:
        raise AssetTruncatedError(f"{where}.byteLength is {length}, but its data has {held} bytes.")


def compressed_view(root: Json, view: int) -> tuple[str, CompressedView] | None:
    """Return the name and checked members of a buffer view's meshopt extension, or None if it has none."""
    data = root["bufferViews"][view]
    where = f"bufferViews[{view}]"
    name = next((name for name in MESHOPT_EXTENSIONS if extension(data, name, where) is not None), None)
    if name is None:
        return None
    body = member(member(data, "extensions", where), name, where)
    where = f"{where}.extensions.{name}"
    buffers = root.get("buffers", [])
    buffer = index(body, "buffer", len(buffers), where)
    if buffer is None:
        raise AssetError(f"{where}.buffer is missing.")
    compressed = CompressedView(
        buffer=buffer,
        offset=integer(body, "byteOffset", where, default=0),
        length=integer(body, "byteLength", where, minimum=1),
        stride=integer(body, "byteStride", where, minimum=1, maximum=256),
        count=integer(body, "count", where, minimum=1),
        mode=text(body, "mode", where) or "",
        filter=text(body, "filter", where) or "NONE",
    )
    if compressed.mode not in {"ATTRIBUTES", "TRIANGLES", "INDICES"}:
        raise AssetUnsupportedError(
            f"{where}.mode is {compressed.mode!r}.", advice="Decompress it: gltf-transform copy in.glb out.glb"
        )
    strides = range(4, 257, 4) if compressed.mode == "ATTRIBUTES" else (2, 4)
    filters = (
        _FILTER_STRIDES.get(compressed.filter, ())
        if compressed.mode == "ATTRIBUTES" or compressed.filter == "NONE"
        else ()
    )
    if (
        compressed.stride not in strides
        or compressed.stride not in filters
        or (compressed.mode == "TRIANGLES" and compressed.count % 3)
    ):
        raise AssetError(f"{where} has an invalid combination of mode, filter, byteStride and count.")
    if compressed.stride * compressed.count != integer(data, "byteLength", f"bufferViews[{view}]", minimum=1):
        raise AssetError(f"{where}: byteStride times count does not equal the buffer view's byteLength.")
    if compressed.offset + compressed.length > integer(buffers[buffer], "byteLength", f"buffers[{buffer}]", minimum=1):
        raise AssetTruncatedError(f"{where} extends past the end of buffer {buffer}.")
    return name, compressed


def _check_view(root: Json, i: int, binary_length: int | None) -> int:
    """Check one buffer view and return how many bytes decoding it will add."""
    view, where = root["bufferViews"][i], f"bufferViews[{i}]"
    buffers = root.get("buffers", [])
    buffer = index(view, "buffer", len(buffers), where)
    if buffer is None:
        raise AssetError(f"{where}.buffer is missing.")
    length = integer(view, "byteLength", where, minimum=1)
    end = integer(view, "byteOffset", where, default=0) + length
    integer(view, "byteStride", where, default=4, minimum=1, maximum=256)
    if end > buffers[buffer]["byteLength"]:
        raise AssetTruncatedError(
            f"{where} ends at byte {end}, but buffer {buffer} has {buffers[buffer]['byteLength']} bytes."
        )
    if not is_placeholder(root, buffer, binary_length):
        return 0
    compressed = compressed_view(root, i)
    if compressed is None or is_placeholder(root, compressed[1].buffer, binary_length):
        raise AssetTruncatedError(f"{where} is in buffer {buffer}, which has no data.")
    return length


def _check_accessor(root: Json, i: int, limits: Limits) -> int:
    """Check one accessor and return how many of its declared bytes are not in the file."""
    accessor, where = root["accessors"][i], f"accessors[{i}]"
    count = integer(accessor, "count", where, minimum=1)
    if count > limits.max_accessor_elements:
        raise AssetTooLargeError(
            f"{where} declares {count} elements; the limit is {limits.max_accessor_elements} "
            "(MESHDEFORM_MAX_ACCESSOR_ELEMENTS)."
        )
    component = integer(accessor, "componentType", where)
    kind = text(accessor, "type", where) or ""
    if component not in COMPONENT_BYTES or kind not in TYPE_COMPONENTS:
        raise AssetError(f"{where} has an unknown componentType or type.")
    if not isinstance(accessor.get("normalized", False), bool):
        raise AssetError(f"{where}.normalized must be true or false.")
    size = COMPONENT_BYTES[component] * TYPE_COMPONENTS[kind]
    if "bufferView" in accessor:
        _check_fits(root, accessor, where, count, size)
    if "sparse" in accessor:
        _check_sparse(root, accessor, where, count, size)
    return 0 if "bufferView" in accessor else count * size


def _check_fits(root: Json, holder: Json, where: str, count: int, size: int, *, strided: bool = True) -> None:
    views = root.get("bufferViews", [])
    at = index(holder, "bufferView", len(views), where)
    if at is None:
        raise AssetError(f"{where}.bufferView is missing.")
    stride = views[at].get("byteStride", size) if strided else size
    end = integer(holder, "byteOffset", where, default=0) + stride * (count - 1) + size
    if end > views[at]["byteLength"]:
        raise AssetTruncatedError(
            f"{where} needs {end} bytes, but buffer view {at} has {views[at]['byteLength']}.",
            advice="The accessor's count, byteOffset or the view's byteStride is wrong; export the file again.",
        )


def _check_sparse(root: Json, accessor: Json, where: str, count: int, size: int) -> None:
    where = f"{where}.sparse"
    sparse = member(accessor, "sparse", where)
    entries = integer(sparse, "count", where, minimum=1, maximum=count)
    indices = member(sparse, "indices", where)
    component = integer(indices, "componentType", f"{where}.indices")
    if component not in (UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT):
        raise AssetError(f"{where}.indices.componentType must be an unsigned integer type.")
    _check_fits(root, indices, f"{where}.indices", entries, COMPONENT_BYTES[component], strided=False)
    _check_fits(root, member(sparse, "values", where), f"{where}.values", entries, size, strided=False)


@dataclass(frozen=True)
class Instance:
    """One node of the default scene that shows a mesh."""

    node: int
    mesh: int
    skin: int | None


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


def check_nodes(root: Json) -> None:
    """Check nodes, scenes and skins: indices in range, finite transforms, and a hierarchy that is a forest."""
    nodes, meshes, skins = objects(root, "nodes"), objects(root, "meshes"), objects(root, "skins")
    parents: dict[int, int] = {}
    for i, node in enumerate(nodes):
        where = f"nodes[{i}]"
        index(node, "mesh", len(meshes), where)
        index(node, "skin", len(skins), where)
        for key, length in (("matrix", 16), ("translation", 3), ("rotation", 4), ("scale", 3)):
            numbers(node, key, length, where)
        numbers(node, "weights", None, where)
        for child in indices(node, "children", len(nodes), where):
            if parents.setdefault(child, i) != i:
                raise AssetError(f"nodes[{child}] is a child of two nodes.")
    _refuse_cycles(parents, len(nodes))
    scenes, accessors = objects(root, "scenes"), objects(root, "accessors")
    for i, node in enumerate(nodes):
        _check_instancing(node, accessors, f"nodes[{i}]")
    for i, scene in enumerate(scenes):
        indices(scene, "nodes", len(nodes), f"scenes[{i}]")
    index(root, "scene", len(scenes), "the document")
    for i, skin in enumerate(skins):
        joints = indices(skin, "joints", len(nodes), f"skins[{i}]")
        if not joints:
            raise AssetError(f"skins[{i}] has no joints.")
        matrices = index(skin, "inverseBindMatrices", len(accessors), f"skins[{i}]")
        if matrices is not None and not (
            accessors[matrices]["type"] == "MAT4"
            and accessors[matrices]["componentType"] == FLOAT
            and accessors[matrices]["count"] >= len(joints)
        ):
            raise AssetError(f"skins[{i}].inverseBindMatrices must be a MAT4 of floats for each joint.")


def _check_instancing(node: Json, accessors: list[Json], where: str) -> None:
    instancing = extension(node, GPU_INSTANCING, where)
    if instancing is None:
        return
    where = f"{where}.extensions.{GPU_INSTANCING}"
    attributes, counts = member(instancing, "attributes", where), set[int]()
    for name in attributes:
        at = index(attributes, name, len(accessors), f"{where}.attributes")
        accessor = accessors[at or 0]
        counts.add(accessor["count"])
        if name in _INSTANCE_TYPES and (
            accessor["type"] != _INSTANCE_TYPES[name] or accessor["componentType"] not in (FLOAT, BYTE, SHORT)
        ):
            raise AssetError(f"{where}: {name} must be a {_INSTANCE_TYPES[name]} of floats or signed integers.")
    if len(counts) > 1:
        raise AssetError(f"{where}: its attributes have different counts: {', '.join(map(str, sorted(counts)))}.")


def instance_count(root: Json, node: int) -> int | None:
    """Return how many times EXT_mesh_gpu_instancing draws a node's mesh, or None if the node does not use it."""
    instancing = root["nodes"][node].get("extensions", {}).get(GPU_INSTANCING)
    if instancing is None:
        return None
    return next((int(root["accessors"][at]["count"]) for at in instancing.get("attributes", {}).values()), 1)


def _refuse_cycles(parents: dict[int, int], count: int) -> None:
    rooted = [False] * count
    for start in range(count):
        path, node = [], start
        while not rooted[node]:
            path.append(node)
            if len(path) > count:
                raise AssetError(f"nodes[{start}] is its own ancestor.")
            if node not in parents:
                break
            node = parents[node]
        for step in path:
            rooted[step] = True


def check_meshes(root: Json) -> tuple[set[int], set[int]]:
    """Check meshes and their primitives.

    Returns the accessors that only a Draco stream fills, and those that only morph targets use, which are never read.
    """
    accessors, views, from_draco = objects(root, "accessors"), objects(root, "bufferViews"), set[int]()
    of_targets, read = set[int](), set[int]()
    for m, mesh in enumerate(objects(root, "meshes")):
        numbers(mesh, "weights", None, f"meshes[{m}]")
        for p, primitive in enumerate(objects(mesh, "primitives", f"meshes[{m}].")):
            where = f"meshes[{m}].primitives[{p}]"
            attributes = member(primitive, "attributes", where)
            used = [index(attributes, name, len(accessors), f"{where}.attributes") for name in attributes]
            used.append(index(primitive, "indices", len(accessors), where))
            read |= {at for at in used if at is not None}
            integer(primitive, "mode", where, default=TRIANGLES, maximum=6)
            targets = objects(primitive, "targets", f"{where}.")
            for t, target in enumerate(targets):
                for name in target:
                    of_targets.add(index(target, name, len(accessors), f"{where}.targets[{t}]") or 0)
            draco = extension(primitive, DRACO, where)
            if draco is not None:
                where = f"{where}.extensions.{DRACO}"
                if index(draco, "bufferView", len(views), where) is None:
                    raise AssetError(f"{where}.bufferView is missing.")
                ids = member(draco, "attributes", where)
                for name in ids:
                    integer(ids, name, where, maximum=2**32)
                from_draco |= {
                    at for at in used if at is not None and not {"bufferView", "sparse"} & accessors[at].keys()
                }
    return from_draco, of_targets - read


def check_geometry(root: Json) -> None:
    """Check that accessors fit their use in primitives; the accessors themselves must be checked already."""
    accessors = objects(root, "accessors")
    for m, mesh in enumerate(objects(root, "meshes")):
        for p, primitive in enumerate(objects(mesh, "primitives")):
            where = f"meshes[{m}].primitives[{p}]"
            attributes = member(primitive, "attributes", where)
            if "POSITION" not in attributes:
                continue
            count = accessors[attributes["POSITION"]]["count"]
            for name, kind in (("POSITION", "VEC3"), ("NORMAL", "VEC3"), ("TANGENT", "VEC4")):
                if name not in attributes:
                    continue
                accessor = accessors[attributes[name]]
                if accessor["type"] != kind or accessor["componentType"] not in _POSITION_TYPES:
                    raise AssetError(f"{where}: {name} must be a {kind} of floats or quantized integers.")
                if accessor["count"] != count:
                    raise AssetError(f"{where}: {name} has {accessor['count']} elements, but POSITION has {count}.")
            if "indices" in primitive:
                accessor = accessors[primitive["indices"]]
                if accessor["type"] != "SCALAR" or accessor["componentType"] not in (
                    UNSIGNED_BYTE,
                    UNSIGNED_SHORT,
                    UNSIGNED_INT,
                ):
                    raise AssetError(f"{where}: indices must be scalars of an unsigned integer type.")


def instances_of(root: Json) -> list[Instance]:
    """List the nodes of the default scene that show a mesh, depth first.

    The default scene is `scene`, else the first one. A document without scenes shows every root node. A node that
    KHR_node_visibility hides shows nothing, and neither do those below it.
    """
    return _walk(root)[0]


def shown_nodes(root: Json) -> list[int]:
    """List the nodes of the default scene, each before those below it."""
    return nodes_below(root, _top_nodes(root))


def nodes_below(root: Json, nodes: list[int]) -> list[int]:
    """Return nodes and all below them, each before those below it."""
    listed = list(dict.fromkeys(nodes))
    known = set(listed)
    for at in listed:  # grows while it is read; nodes form a forest
        below = [child for child in root["nodes"][at].get("children", []) if child not in known]
        known.update(below)
        listed += below
    return listed


def _top_nodes(root: Json) -> list[int]:
    """Return the nodes at the top of the default scene."""
    nodes, scenes = objects(root, "nodes"), objects(root, "scenes")
    if scenes:
        return indices(scenes[root.get("scene", 0)], "nodes", len(nodes), "scene")
    children = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in children]


def _walk(root: Json) -> tuple[list[Instance], list[Instance]]:
    """Return the instances that are shown, and those that are hidden."""
    nodes, start = objects(root, "nodes"), _top_nodes(root)
    shown, hidden, seen = list[Instance](), list[Instance](), set[int]()
    stack = [(at, True) for at in start[::-1]]
    while stack:
        at, visible = stack.pop()
        if at in seen:
            continue
        seen.add(at)
        node = nodes[at]
        visibility = extension(node, VISIBILITY, f"nodes[{at}]") or {}
        visible &= visibility.get("visible", True) is not False
        if "mesh" in node:
            (shown if visible else hidden).append(Instance(at, node["mesh"], node.get("skin")))
        stack.extend((child, visible) for child in reversed(node.get("children", [])))
    return shown, hidden


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
    deformed (`assets.surface`); empty until the file is decoded. `bounds`: least and greatest coordinates of what is
    drawn, (2, 3), in the file's world; empty until the file is decoded.
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
    shown, hidden = _walk(root)
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
