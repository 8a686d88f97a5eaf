"""Check nodes, scenes, meshes and skins, and list the mesh instances of the default scene. Pure Python.

Source: glTF 2.0 specification, sections 3.5 (Scenes) and 3.7 (Geometry).
"""

from __future__ import annotations

from dataclasses import dataclass

from meshdeform.assets.container import Json, extension, index, indices, integer, member, numbers, objects
from meshdeform.assets.storage import (
    BYTE,
    FLOAT,
    MESHOPT_EXTENSIONS,
    SHORT,
    UNSIGNED_BYTE,
    UNSIGNED_INT,
    UNSIGNED_SHORT,
)
from meshdeform.errors import AssetError, AssetUnsupportedError

__all__ = [
    "DRACO",
    "GPU_INSTANCING",
    "Instance",
    "check_extensions",
    "check_meshes",
    "check_nodes",
    "hidden_instances",
    "instance_count",
    "instances_of",
]

DRACO = "KHR_draco_mesh_compression"
GPU_INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
POINTS, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = 0, 4, 5, 6
LOOSE = "points and lines only follow a surface"
"""Why a file of nothing but points and lines is refused."""
MODE_NAMES = ("points", "lines", "line loop", "line strip", "triangles", "triangle strip", "triangle fan")

# Required extensions that are supported, or that change neither positions nor their meaning.
_READ = {DRACO, GPU_INSTANCING, *MESHOPT_EXTENSIONS, "KHR_mesh_quantization"}
_HARMLESS = (
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "KHR_animation_pointer", "KHR_node_"),
    *("EXT_texture_", "EXT_lights_", "EXT_materials_", "MSFT_texture_", "VRMC_", "VRM", "EXT_structural_metadata"),
    *("EXT_mesh_features", "EXT_instance_features", "CESIUM_primitive_outline", "CESIUM_RTC", "GODOT_", "AGI_"),
)
_INSTANCE_TYPES = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
_POSITION_TYPES = (FLOAT, BYTE, UNSIGNED_BYTE, SHORT, UNSIGNED_SHORT)


@dataclass(frozen=True)
class Instance:
    """One node of the default scene that shows a mesh."""

    node: int
    mesh: int
    skin: int | None


def check_extensions(root: Json) -> None:
    """Refuse an asset that requires an unknown extension, which might change the geometry.

    Raises
    ------
    AssetUnsupportedError
        The message names the extension.
    """
    required = root.get("extensionsRequired", [])
    if not isinstance(required, list) or not all(isinstance(name, str) for name in required):
        raise AssetError("extensionsRequired must be an array of names.")
    for name in required:
        if name not in _READ and not name.startswith(_HARMLESS):
            raise AssetUnsupportedError(f"The asset requires the extension {name[:100]!r}.")


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
    many = extension(node, GPU_INSTANCING, where)
    if many is None:
        return
    where = f"{where}.extensions.{GPU_INSTANCING}"
    attributes, counts = member(many, "attributes", where), set[int]()
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
    many = root["nodes"][node].get("extensions", {}).get(GPU_INSTANCING)
    if many is None:
        return None
    return next((int(root["accessors"][at]["count"]) for at in many.get("attributes", {}).values()), 1)


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

    Returns
    -------
    The accessors that only a Draco stream fills, and those that only morph targets use, which are never read.
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


def hidden_instances(root: Json) -> list[Instance]:
    """List the nodes of the default scene whose mesh KHR_node_visibility hides."""
    return _walk(root)[1]


def _walk(root: Json) -> tuple[list[Instance], list[Instance]]:
    """Return the instances that are shown, and those that are hidden."""
    nodes, scenes = objects(root, "nodes"), objects(root, "scenes")
    if scenes:
        start = indices(scenes[root.get("scene", 0)], "nodes", len(nodes), "scene")
    else:
        children = {child for node in nodes for child in node.get("children", [])}
        start = [i for i in range(len(nodes)) if i not in children]
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
