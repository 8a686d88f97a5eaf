"""Check nodes, scenes, meshes and skins from the JSON alone, and list what the default scene shows.

Source: glTF 2.0 specification, sections 3.5 (Scenes) and 3.7 (Geometry); KHR_node_visibility; EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

from dataclasses import dataclass

from meshdeform.assets.codes import (
    BYTE,
    DRACO,
    FLOAT,
    GPU_INSTANCING,
    SHORT,
    TRIANGLES,
    UNSIGNED_BYTE,
    UNSIGNED_INT,
    UNSIGNED_SHORT,
    VISIBILITY,
)
from meshdeform.assets.container import Json, extension, index, indices, integer, member, numbers, objects
from meshdeform.errors import AssetError

_INSTANCE_TYPES = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
_POSITION_TYPES = (FLOAT, BYTE, UNSIGNED_BYTE, SHORT, UNSIGNED_SHORT)


@dataclass(frozen=True)
class Instance:
    """One node of the default scene that shows a mesh."""

    node: int
    mesh: int
    skin: int | None


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
    return shown_and_hidden(root)[0]


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


def shown_and_hidden(root: Json) -> tuple[list[Instance], list[Instance]]:
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
