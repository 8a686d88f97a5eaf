"""Write new shapes as further morph targets, with an animation of their weights.

The targets are appended, so that existing weights keep their positions. Everything with one value per target is
extended: the targets of the mesh's other primitives, the weights of meshes and nodes, and the outputs of existing
weight animations (where the new weights have their values at rest, so that they show the deformed asset).

Source: glTF 2.0 specification, sections 3.7.2.2 (Morph targets) and 3.11 (Animations).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block, LocalShape
from meshdeform.assets.unchecked import animated, channels_of

ANIMATION_NAME = "deform"
_DURATION_S = 1.0
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MorphTarget:
    """A named shape: positions (N, 3), normals (N, 3) and tangents (N, 4) as for `Asset.replace`."""

    name: str
    positions: _Floats
    normals: _Floats | None = None
    tangents: _Floats | None = None


@dataclass(frozen=True)
class WeightTrack:
    """An animation of the new targets' weights."""

    times: Sequence[float]  # (K,) float: seconds, ascending
    weights: Sequence[Sequence[float]]
    """(K, T) float: weights of the new targets at these times; between them they are interpolated linearly."""
    name: str = ANIMATION_NAME


@dataclass(frozen=True)
class NewTargets:
    """Additions to a document: names and weights at rest of the targets (T), and their animation."""

    names: Sequence[str]
    weights: Sequence[float]
    track: WeightTrack | None


def straight() -> WeightTrack:
    """Return the animation of a single target from 0 to 1."""
    return WeightTrack((0.0, _DURATION_S), ((0.0,), (1.0,)))


def add_morph_targets(
    document: Document, blocks: list[Block], shapes: list[list[LocalShape]], owners: dict[int, int], new: NewTargets
) -> None:
    """Add shapes as morph targets to the deformed meshes.

    `document`: changed in place; `shapes`: for each target, the new vertices of each block. `owners`: the mesh of each
    deformed node. No two nodes share a mesh.
    """
    meshes = document.root["meshes"]
    before = {
        node: max((len(primitive.get("targets", [])) for primitive in meshes[mesh]["primitives"]), default=0)
        for node, mesh in owners.items()
    }
    for number, shape in enumerate(shapes):
        targets: dict[int, dict[int, Json]] = {node: {} for node in owners}
        for block, local in zip(blocks, shape, strict=True):
            target = _target(document, block, local)
            targets[block.node] |= dict.fromkeys(block.primitives, target)
        for node, mesh in owners.items():
            _add_target(document, meshes[mesh], targets[node], before[node] + number)
    for node, mesh in owners.items():
        _grow_weights(document.root["nodes"][node], meshes[mesh], before[node], new)
    _grow_animations(document, owners, before, new.weights)
    if new.track is not None:
        _add_animation(document, owners, before, new.track)


def _target(document: Document, block: Block, shape: LocalShape) -> Json:
    """Append a block's displacements from the base, and return them as a target; tangents omit their handedness."""
    target: Json = {"POSITION": document.append_accessor(shape.positions - block.positions, bounds=True)}
    if shape.normals is not None and block.normals is not None:
        target["NORMAL"] = document.append_accessor(shape.normals - block.normals)
    if shape.tangents is not None and block.tangents is not None:
        target["TANGENT"] = document.append_accessor((shape.tangents - block.tangents)[:, :3])
    return target


def _add_target(document: Document, mesh: Json, targets: dict[int, Json], count: int) -> None:
    """Add one target to each primitive, of zeros if it does not move, since all need the same number of targets."""
    for p, primitive in enumerate(mesh["primitives"]):
        if "POSITION" not in primitive.get("attributes", {}):
            continue
        own = primitive.setdefault("targets", [])
        vertices = document.root["accessors"][primitive["attributes"]["POSITION"]]["count"]
        while len(own) < count + (p not in targets):
            own.append({"POSITION": document.append_zeros(vertices)})
        if p in targets:
            own.append(dict(targets[p]))


def _grow_weights(node: Json, mesh: Json, count: int, new: NewTargets) -> None:
    for owner in (mesh, node):
        if owner is mesh or "weights" in owner:
            own = owner.get("weights", [])
            owner["weights"] = [*own[:count], *[0.0] * (count - len(own)), *new.weights]
    # Importers read the targets' names from here, one per target.
    extras = mesh.setdefault("extras", {})
    if isinstance(extras, dict):
        names = extras.get("targetNames", [])
        if isinstance(names, list) and len(names) == count:
            extras["targetNames"] = [*names, *new.names]
        elif not extras:
            del mesh["extras"]


def _grow_animations(document: Document, owners: dict[int, int], before: dict[int, int], rest: Sequence[float]) -> None:
    """Add columns for the new targets to existing animations of the deformed nodes' weights."""
    grown: dict[tuple[int, int, int], int] = {}
    outputs: dict[tuple[str, str, int], int | None] = {}
    by_mesh = {mesh: node for node, mesh in owners.items()}
    for channel, _, animation in channels_of(document.root):
        (array, number, prop), sampler, samplers = animated(channel), channel.get("sampler"), animation.get("samplers")
        node = number if array == "nodes" else by_mesh.get(number, -1) if array == "meshes" else -1
        if (
            prop != "weights"
            or not before.get(node)
            or not isinstance(samplers, list)
            or not _is_index(sampler, samplers)
        ):
            continue
        key = (id(samplers), sampler, before[node])
        if key not in grown:
            # Samplers that share an output keep sharing it.
            source = samplers[sampler]
            sampler_key = (str(source.get("output")), str(source.get("interpolation")), before[node])
            if sampler_key not in outputs:
                outputs[sampler_key] = _grown_output(document, source, before[node], rest)
            output = outputs[sampler_key]
            if output is None:
                continue
            samplers.append({**source, "output": output})
            grown[key] = len(samplers) - 1
        channel["sampler"] = grown[key]


def _is_index(value: object, array: list[Json]) -> TypeGuard[int]:
    return isinstance(value, int) and 0 <= value < len(array) and isinstance(array[value], dict)


def _grown_output(document: Document, sampler: Json, count: int, rest: Sequence[float]) -> int | None:
    """Append a copy of a sampler's output with the new weights for each key; return None if it is not valid."""
    output, accessors = sampler.get("output"), document.items("accessors")
    if not _is_index(output, accessors) or accessors[output]["type"] != "SCALAR":
        return None
    values = read_floats(document, output)[:, 0]
    if len(values) % count:
        return None
    rows = values.reshape(-1, count)
    columns = np.tile(np.asarray(rest, np.float32), (len(rows), 1))
    if sampler.get("interpolation") == "CUBICSPLINE":  # in-tangent, value, out-tangent of each key
        columns[0::3] = columns[2::3] = 0.0
    wider: NDArray[np.float32] = np.column_stack([rows, columns]).reshape(-1)
    return document.append_accessor(wider, like=accessors[output], vertex=False)


def _add_animation(document: Document, owners: dict[int, int], before: dict[int, int], track: WeightTrack) -> None:
    times = document.append_accessor(np.array(track.times, np.float32), bounds=True, vertex=False)
    samplers: list[Json] = []
    channels: list[Json] = []
    for node, mesh in owners.items():
        base = document.root["nodes"][node].get("weights", document.root["meshes"][mesh]["weights"])[: before[node]]
        keys = np.array([[*base, *row] for row in track.weights], np.float32).reshape(-1)
        output = document.append_accessor(keys, vertex=False)
        samplers.append({"input": times, "interpolation": "LINEAR", "output": output})
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": "weights"}})
    document.items("animations").append({"name": track.name, "channels": channels, "samplers": samplers})
