"""`compact`: what the new shape made unused is gone, and everything that is referenced is what it was."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.accessors import read_accessor
from meshdeform.assets.document import Document
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, Builder, pack, unpack
from tests.unit.assets.test_archive import scene
from tests.unit.assets.test_carried import mixed
from tests.unit.assets.test_compressed import draco_asset, draco_stream, meshopt_asset
from tests.unit.assets.test_fuzz import kitchen_sink
from tests.unit.assets.test_morph import with_targets
from tests.unit.assets.test_repair import damaged
from tests.unit.assets.test_replace import DOT, position, text_gltf

PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
UVS = QUAD_VERTS[:, :2].copy()


def separate() -> bytes:
    """Return a quad with a view for each accessor, an image, bytes that no view covers, and an unused accessor."""
    builder = Builder()
    primitive = builder.primitive(NORMAL=QUAD_NORMALS, TEXCOORD_0=UVS)
    builder.accessor(QUAD_VERTS * 7)
    builder.root["images"] = [{"bufferView": builder.view(PNG), "mimeType": "image/png"}]
    builder.binary += b"own data"
    builder.node(builder.mesh(primitive))
    return builder.glb((b"XTRA", b"abcd"))


def interleaved(positions: Any = QUAD_VERTS) -> bytes:
    """Return a quad whose attributes share one view, row by row."""
    builder = Builder()
    rows = np.column_stack(
        [np.ascontiguousarray(a).view(np.uint8).reshape(4, -1) for a in (positions, QUAD_NORMALS, UVS)]
    )
    view = builder.view(rows.tobytes(), byteStride=rows.shape[1], target=34962)
    attributes, offset = {}, 0
    for name, values in (("POSITION", positions), ("NORMAL", QUAD_NORMALS), ("TEXCOORD_0", UVS)):
        component = {np.float32: 5126, np.int16: 5122}[values.dtype.type]
        columns = 2 if name == "TEXCOORD_0" else 3
        item = {
            "bufferView": view,
            "byteOffset": offset,
            "componentType": component,
            "count": 4,
            "type": f"VEC{columns}",
        }
        builder.root["accessors"].append(item)
        attributes[name], offset = len(builder.root["accessors"]) - 1, offset + values.itemsize * values.shape[1]
    builder.root["accessors"][0] |= {
        "min": positions[:, :3].min(axis=0).tolist(),
        "max": positions[:, :3].max(axis=0).tolist(),
    }
    builder.node(builder.mesh({"attributes": attributes, "indices": builder.accessor(QUAD_FACES.reshape(-1))}))
    return builder.glb()


def quantized() -> bytes:
    """Return an interleaved quad of 16-bit integers, which no floats fit into."""
    positions = np.column_stack([QUAD_VERTS * 100, np.zeros(4)]).astype(np.int16)
    root, binary, _ = unpack(interleaved(positions))
    return pack(
        root | {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}, binary
    )


def embedded() -> bytes:
    """Return a quad whose buffer is a data URI."""
    root, binary, _ = unpack(interleaved())
    payload = base64.b64encode(binary[: root["buffers"][0]["byteLength"]]).decode()
    root["buffers"][0]["uri"] = f"data:;base64,{payload}"
    return pack(root)


def instances() -> bytes:
    """Return two nodes that show one mesh."""
    root, binary, _ = unpack(separate())
    root["nodes"].append({"mesh": 0, "translation": [3, 0, 0]})
    root["scenes"][0]["nodes"].append(1)
    return pack(root, binary)


def animated() -> bytes:
    builder = with_targets(2)
    node = builder.node(0)
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    sampler = {"input": times, "output": builder.accessor(np.array([0, 0.5, 1, 0.25], np.float32))}
    channel = {"sampler": 0, "target": {"node": node, "path": "weights"}}
    builder.root["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    return builder.glb()


ASSETS: dict[str, Callable[[], bytes]] = {
    "separate": separate,
    "interleaved": interleaved,
    "quantized": quantized,
    "embedded": embedded,
    "instances": instances,
    "animated": animated,
    "skin, strip, sparse, targets": kitchen_sink,
    "draco": lambda: draco_asset(draco_stream()).glb(),
    "meshopt": lambda: meshopt_asset().glb(),
    "data URIs": text_gltf,
    "zip": lambda: packed(scene()),
    "points and lines": lambda: mixed().glb(),
    "normals without a direction": lambda: damaged(np.nan).glb(),
}


def written(data: bytes, *, compact: bool, morph: bool = False) -> bytes:
    asset = load_asset(data)
    surface = asset.surface
    moved = surface.positions + np.sin(surface.positions[:, [1, 2, 0]])
    return asset.replace(moved, surface.normals[:, [1, 2, 0]], surface.tangents, morph=morph, compact=compact)


def resolved(document: Document, value: Any, key: str = "") -> Any:
    """Return the JSON with indices of accessors and views replaced by what they refer to."""
    if isinstance(value, dict) and "attributes" in value:
        value = {**value, "attributes": {name: {"accessor": at} for name, at in value["attributes"].items()}}
        value["targets"] = [
            {name: {"accessor": at} for name, at in target.items()} for target in value.get("targets", [])
        ]
    if isinstance(value, dict):
        return {name: resolved(document, item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [resolved(document, item, key) for item in value]
    if key in {"accessor", "indices", "input", "output", "inverseBindMatrices"} and isinstance(value, int):
        item = document.root["accessors"][value]
        kept = {name: item[name] for name in item if name not in {"bufferView", "byteOffset", "sparse"}}
        return kept, read_accessor(document, value).tolist()
    if key == "bufferView":
        return bytes(document.view_bytes(value))
    return value


def content(glb: bytes) -> dict[str, Any]:
    document = Document.parse(glb, Limits(), glb=True)
    places = ("accessors", "bufferViews", "buffers")
    return {key: resolved(document, value) for key, value in document.root.items() if key not in places}


@each_case("name", list(ASSETS))
@each_case("morph", [False, True])
def test_everything_that_is_referenced_is_the_same(name: str, morph: bool) -> None:
    data = ASSETS[name]()
    plain, small = (written(data, compact=compact, morph=morph) for compact in (False, True))
    assert content(small) == content(plain)
    assert len(small) <= len(plain)
    assert unpack(small)[2] == unpack(plain)[2]  # unknown chunks
    np.testing.assert_array_equal(load_asset(small).surface.positions, load_asset(plain).surface.positions)


@each_case("name", ["separate", "interleaved", "embedded"])
def test_floats_are_replaced_where_they_were(name: str) -> None:
    data = ASSETS[name]()
    before, binary_before, _ = unpack(data)
    after, binary, _ = unpack(written(data, compact=True))
    for key in ("bufferViews", "meshes", "nodes"):
        assert after[key] == before[key]
    assert len(after["accessors"]) == len(before["accessors"])
    assert len(binary) - before["buffers"][0]["byteLength"] < 4
    assert not binary_before or b"own data" not in binary_before or b"own data" in binary


@each_case("name", ["draco", "meshopt"])
def test_compressed_streams_are_dropped(name: str) -> None:
    data = ASSETS[name]()
    root, binary, _ = unpack(written(data, compact=True))
    stream = draco_stream() if name == "draco" else unpack(data)[1][:8]
    assert stream not in binary
    referenced = sum(view["byteLength"] for view in root["bufferViews"])
    assert referenced <= len(binary) <= referenced + 4 * len(root["bufferViews"])


def test_what_is_replaced_leaves_no_rows_behind() -> None:
    data = text_gltf()
    root, binary, _ = unpack(written(data, compact=True))
    sizes = [buffer["byteLength"] for buffer in json.loads(data)["buffers"]]
    assert len(root["buffers"]) == 1
    assert sum(sizes) + len(DOT) <= len(binary) < sum(sizes) + len(DOT) + 12
    assert root["meshes"] == json.loads(data)["meshes"]
    data = damaged(np.nan).glb()
    before, after = unpack(data), unpack(written(data, compact=True))
    assert len(after[1]) == len(before[1])
    for key in ("accessors", "bufferViews"):
        assert len(after[0][key]) == len(before[0][key])
    root, binary, _ = unpack(written(quantized(), compact=True))
    assert len(root["accessors"]) == 4
    assert len(binary) == 4 * 28 + 12 + 48  # the shared view, the indices, and the new positions; normals fit


@each_case("place", ["extensions", "extras"])
def test_an_index_that_may_be_a_reference_keeps_its_values(place: str) -> None:
    root, binary, _ = unpack(separate())
    body = {"X_unknown": {"source": 0}} if place == "extensions" else {"source": 0}
    root["nodes"][0][place] = body
    small = written(pack(root, binary), compact=True)
    after, _, _ = unpack(small)
    document = Document.parse(small, Limits(), glb=True)
    np.testing.assert_array_equal(read_accessor(document, 0), QUAD_VERTS)
    assert after["meshes"][0]["primitives"][0]["attributes"]["POSITION"] != 0
    assert after["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] == 1
    assert np.abs(position(small) - QUAD_VERTS).max() > 0.1


def test_provenance_is_stored_beside_what_is_there() -> None:
    root, binary, _ = unpack(separate())
    root["asset"]["extras"] = {"author": "é"}
    asset = load_asset(pack(root, binary))
    glb = asset.replace(asset.surface.positions, provenance={"prompt": "a vase", "seed": 7})
    assert unpack(glb)[0]["asset"]["extras"] == {"author": "é", "meshdeform": {"prompt": "a vase", "seed": 7}}
    assert unpack(asset.replace(asset.surface.positions))[0]["asset"]["extras"] == {"author": "é"}
    root, binary, _ = unpack(separate())
    root["asset"]["extras"] = ["a", 1]
    asset = load_asset(pack(root, binary))
    assert unpack(asset.replace(asset.surface.positions, provenance={"seed": 7}))[0]["asset"]["extras"] == ["a", 1]
