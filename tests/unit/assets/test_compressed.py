"""Draco and meshopt in whole documents: decoded into plain data, and the extensions go once nothing uses them."""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import Limits, load_asset
from meshdeform.errors import AssetError, AssetTooLargeError, AssetTruncatedError
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, Builder, unpack
from tests.unit.assets.test_replace import accessor, position

DRACO = "KHR_draco_mesh_compression"
UVS = QUAD_VERTS[:, :2].copy()
COLORS = np.arange(12, dtype=np.uint8).reshape(4, 3)


@cache
def draco_stream() -> bytes:
    dracopy = pytest.importorskip("DracoPy", reason="DracoPy is not installed")
    data: bytes = dracopy.encode(
        QUAD_VERTS,
        QUAD_FACES.astype(np.uint32),
        quantization_bits=14,
        preserve_order=True,
        colors=COLORS,
        generic_attributes={7: UVS, 8: QUAD_NORMALS},
    )
    return data


def draco_ids(stream: bytes) -> dict[str, int]:
    import DracoPy

    kinds = {item["attribute_type"]: item["unique_id"] for item in DracoPy.decode(stream).attributes}
    return {"POSITION": kinds[0], "COLOR_0": kinds[2], "TEXCOORD_0": 7, "NORMAL": 8}


def draco_asset(stream: bytes, **changes: Any) -> Builder:
    builder = Builder()
    kinds = {"POSITION": "VEC3", "COLOR_0": "VEC3", "TEXCOORD_0": "VEC2", "NORMAL": "VEC3"}
    attributes = {}
    for name, kind in kinds.items():
        component = 5121 if name == "COLOR_0" else 5126
        builder.root["accessors"].append({"componentType": component, "count": 4, "type": kind, "name": name})
        attributes[name] = len(builder.root["accessors"]) - 1
    builder.root["accessors"][0] |= {"min": [0, 0, 0], "max": [1, 1, 0.5]}
    builder.root["accessors"][1]["normalized"] = True
    builder.root["accessors"].append({"componentType": 5123, "count": 6, "type": "SCALAR"})
    extension = {"bufferView": builder.view(stream), "attributes": draco_ids(draco_stream())}
    primitive = {"attributes": attributes, "indices": 4, "extensions": {DRACO: extension, "X_kept": {}}}
    builder.node(builder.mesh({**primitive, **changes}))
    builder.root |= {"extensionsUsed": ["X_kept", DRACO], "extensionsRequired": [DRACO]}
    return builder


def test_draco_becomes_plain_accessors() -> None:
    builder = draco_asset(draco_stream())
    asset = load_asset(builder.glb())
    surface = asset.surface
    np.testing.assert_allclose(surface.positions, QUAD_VERTS, atol=1e-4)
    np.testing.assert_array_equal(surface.triangles, QUAD_FACES)
    np.testing.assert_allclose(surface.normals, QUAD_NORMALS, atol=1e-6)
    root, binary, _ = unpack(asset.replace(surface.positions * 2))
    assert binary.startswith(builder.binary)
    assert root["extensionsUsed"] == ["X_kept"]
    assert "extensionsRequired" not in root
    primitive = root["meshes"][0]["primitives"][0]
    assert primitive["extensions"] == {"X_kept": {}}
    colors = root["accessors"][primitive["attributes"]["COLOR_0"]]
    view = root["bufferViews"][colors["bufferView"]]
    assert (colors["normalized"], colors["name"], view["byteStride"]) == (True, "COLOR_0", 4)
    rows = np.frombuffer(binary, np.uint8, 16, view["byteOffset"]).reshape(4, 4)
    np.testing.assert_array_equal(rows[:, :3], COLORS)
    assert load_asset(asset.replace(surface.positions * 2)).surface.triangles.tolist() == QUAD_FACES.tolist()


def draco_skin() -> Builder:
    """Return a skinned patch of 81 vertices whose weights Draco rounds, with an index maximum that is too low."""
    import DracoPy

    side = np.arange(9, dtype=np.float32) / 8
    verts = np.stack([*(axis.reshape(-1) for axis in np.meshgrid(side, side)), np.zeros(81, np.float32)], axis=1)
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1)
    faces = np.concatenate([corner[:, None] + [0, 1, 9], corner[:, None] + [9, 1, 10]]).astype(np.uint32)
    weights = np.random.default_rng(0).random((81, 4)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    tangents = np.tile(np.float32([0.6, 0.8, 0, -1]), (81, 1))
    generic = {1: weights, 2: np.tile(np.arange(4, dtype=np.uint8), (81, 1)), 3: tangents}
    stream = DracoPy.encode(verts, faces, quantization_bits=11, preserve_order=True, generic_attributes=generic)
    builder = Builder()
    primitive = builder.primitive(verts, faces.astype(np.uint16), JOINTS_0=generic[2], WEIGHTS_0=weights)
    builder.binary = b""
    builder.root["bufferViews"] = []
    normals = {"componentType": 5126, "count": 81, "type": "VEC4"}
    builder.root["accessors"].append(normals)
    primitive["attributes"]["TANGENT"] = len(builder.root["accessors"]) - 1
    for item in builder.root["accessors"]:
        item.pop("bufferView", None)
    builder.root["accessors"][primitive["indices"]] |= {"min": [0], "max": [40]}
    position = next(item["unique_id"] for item in DracoPy.decode(stream).attributes if item["attribute_type"] == 0)
    ids = {"POSITION": position, "WEIGHTS_0": 1, "JOINTS_0": 2, "TANGENT": 3}
    primitive["extensions"] = {DRACO: {"bufferView": builder.view(stream), "attributes": ids}}
    builder.node(builder.mesh(primitive), skin=0)
    builder.root["skins"] = [{"joints": [builder.node() for _ in range(4)]}]
    builder.root |= {"extensionsUsed": [DRACO], "extensionsRequired": [DRACO]}
    return builder


def test_weights_and_tangents_are_exact_after_draco_and_the_bounds_of_indices_are_those_of_the_data() -> None:
    pytest.importorskip("DracoPy", reason="DracoPy is not installed")
    asset = load_asset(draco_skin().glb())
    written = asset.replace(asset.surface.positions)
    root, binary, _ = unpack(written)
    primitive = root["meshes"][0]["primitives"][0]
    weights = accessor(root, binary, primitive["attributes"]["WEIGHTS_0"])
    np.testing.assert_allclose(weights.astype(np.float64).sum(axis=1), 1.0, atol=4e-7, rtol=0)  # the validator's bound
    tangents = accessor(root, binary, primitive["attributes"]["TANGENT"])
    np.testing.assert_allclose(np.linalg.norm(tangents[:, :3], axis=1), 1.0, atol=1e-6)
    assert set(tangents[:, 3]) == {-1.0}
    indices = root["accessors"][primitive["indices"]]
    assert (indices["min"], indices["max"]) == ([0], [80])


def test_a_draco_primitive_that_is_not_deformed_stays_compressed() -> None:
    builder = draco_asset(draco_stream())
    hidden = builder.mesh(builder.root["meshes"][0]["primitives"][0])
    builder.root["scenes"][0]["nodes"] = [builder.node(builder.mesh(builder.primitive()), in_scene=False)]
    asset = load_asset(builder.glb())
    root, _, _ = unpack(asset.replace(asset.surface.positions * 2))
    assert DRACO in root["meshes"][hidden]["primitives"][0]["extensions"]
    assert root["extensionsRequired"] == [DRACO]


def quantized_in_draco(positions: NDArray[np.int32]) -> bytes:
    """The GLB of a quad whose stream holds integers, for an accessor of normalized 16-bit integers."""
    dracopy = pytest.importorskip("DracoPy", reason="DracoPy is not installed")
    builder = Builder()
    stream = dracopy.encode(positions, QUAD_FACES.astype(np.uint32), preserve_order=True)
    builder.root["accessors"] += [
        {"componentType": 5122, "normalized": True, "count": 4, "type": "VEC3"},
        {"componentType": 5123, "count": 6, "type": "SCALAR"},
    ]
    extension = {"bufferView": builder.view(stream), "attributes": {"POSITION": 0}}
    builder.root["extensionsUsed"] = builder.root["extensionsRequired"] = [DRACO, "KHR_mesh_quantization"]
    builder.node(builder.mesh({"attributes": {"POSITION": 0}, "indices": 1, "extensions": {DRACO: extension}}))
    return builder.glb()


def test_draco_streams_of_integers_keep_them() -> None:
    positions = np.array([[0, 0, 0], [32767, 0, 0], [32767, 32767, 0], [0, 32767, -16001]], np.int32)
    surface = load_asset(quantized_in_draco(positions)).surface
    np.testing.assert_allclose(surface.positions, positions / 32767, atol=1e-9)
    with pytest.raises(AssetError, match="32768"):
        load_asset(quantized_in_draco(positions + [1, 0, 0]))


def test_a_draco_stream_that_does_not_fit_its_accessors_is_told() -> None:
    for change in ({"count": 5}, {"type": "VEC4"}):
        builder = draco_asset(draco_stream())
        builder.root["accessors"][2] |= change
        with pytest.raises(AssetError):
            load_asset(builder.glb())
    with pytest.raises(AssetError, match="Draco"):
        load_asset(draco_asset(b"DRACO" + bytes(40)).glb())
    # A strip becomes the list that its stream holds.
    asset = load_asset(draco_asset(draco_stream(), mode=5).glb())
    assert asset.surface.triangles.tolist() == QUAD_FACES.tolist()
    assert unpack(asset.replace(asset.surface.positions))[0]["meshes"][0]["primitives"][0]["mode"] == 4


# One triangle's three positions as 4-byte integers of meshopt's version 0, and its indices.
def meshopt_asset(*, fallback: bool = False, name: str = "EXT_meshopt_compression") -> Builder:
    meshoptimizer = pytest.importorskip("meshoptimizer", reason="meshoptimizer (test only) is not installed")
    meshoptimizer.encode_vertex_version(0)
    builder = Builder()
    builder.primitive(NORMAL=QUAD_NORMALS)
    plain = builder.binary
    streams = [
        ("ATTRIBUTES", 4, 12, meshoptimizer.encode_vertex_buffer(QUAD_VERTS, 4, 12)),
        ("TRIANGLES", 6, 2, meshoptimizer.encode_index_buffer(QUAD_FACES.reshape(-1).astype(np.uint32), 6, 4)),
        ("ATTRIBUTES", 4, 12, meshoptimizer.encode_vertex_buffer(QUAD_NORMALS, 4, 12)),
    ]
    order = {0: 0, 1: 2, 2: 1}  # Builder.primitive makes positions, normals, indices
    packed = b""
    for view, which in order.items():
        mode, count, stride, data = streams[which]
        packed += b"\0" * (-len(packed) % 4)
        builder.root["bufferViews"][view] |= {
            "buffer": 1,
            "byteLength": count * stride,
            "extensions": {
                name: {
                    "buffer": 0,
                    "byteOffset": len(packed),
                    "byteLength": len(data),
                    "byteStride": stride,
                    "count": count,
                    "mode": mode,
                }
            },
        }
        packed += data
    builder.binary = packed
    builder.root["buffers"] = [{"byteLength": len(plain), "extensions": {name: {"fallback": True}}}]
    if fallback:
        import base64

        builder.root["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(plain).decode()
    used = {"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}
    builder.node(builder.mesh(used))
    builder.root["extensionsUsed"] = [name]
    if not fallback:
        builder.root["extensionsRequired"] = [name]
    return builder


def test_buffers_behind_a_placeholder_keep_their_own_data() -> None:
    """The streams are in one data URI and the texture coordinates in another, behind the placeholder."""
    import base64

    builder = meshopt_asset()
    root, streams = builder.root, builder.binary
    uvs = np.linspace(0, 1, 8, dtype=np.float32).reshape(4, 2)
    for view in root["bufferViews"]:
        (extension,) = view["extensions"].values()
        extension["buffer"] = 2
    root["bufferViews"].append({"buffer": 3, "byteLength": uvs.nbytes})
    root["accessors"].append({"bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC2"})
    root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = len(root["accessors"]) - 1
    builder.binary = b"image"
    root["buffers"] += [
        {"byteLength": len(data), "uri": "data:;base64," + base64.b64encode(data).decode()}
        for data in (streams, uvs.tobytes())
    ]
    asset = load_asset(builder.glb())
    for data in (asset.to_bytes(), asset.replace(asset.surface.positions + 1)):
        again = load_asset(data)
        assert again.texture_coordinates() == asset.texture_coordinates()
    (found,) = asset.texture_coordinates().values()
    assert found == hashlib.sha256(uvs.tobytes()).hexdigest()


def triangles_up_to_rotation(triangles: np.ndarray) -> list[list[int]]:
    return sorted(np.roll(row, -int(np.argmin(row))).tolist() for row in triangles)


@each_case("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_becomes_plain_views(name: str) -> None:
    builder = meshopt_asset(name=name)
    asset = load_asset(builder.glb())
    np.testing.assert_array_equal(asset.surface.positions, QUAD_VERTS)
    np.testing.assert_allclose(asset.surface.normals, QUAD_NORMALS, atol=1e-7)
    assert triangles_up_to_rotation(asset.surface.triangles) == triangles_up_to_rotation(QUAD_FACES)
    written = asset.replace(asset.surface.positions * 2, asset.surface.normals)
    root, binary, _ = unpack(written)
    assert binary.startswith(builder.binary)
    assert "extensionsUsed" not in root
    assert "extensionsRequired" not in root
    assert len(root["buffers"]) == 1
    assert all(view["buffer"] == 0 and "extensions" not in view for view in root["bufferViews"])
    np.testing.assert_array_equal(position(written), QUAD_VERTS * 2)
    np.testing.assert_array_equal(load_asset(written).surface.triangles, asset.surface.triangles)


def test_weights_sum_to_one_after_a_lossy_filter() -> None:
    import meshoptimizer

    builder = meshopt_asset()
    weights = np.random.default_rng(0).random((4, 4)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    packed = (np.int64(-10) << 24 | np.round(weights * 2**10).astype(np.int64) & 0xFFFFFF).astype(np.uint32)
    at = builder.view(meshoptimizer.encode_vertex_buffer(packed, 4, 16))
    stream = {key: builder.root["bufferViews"][at][key] for key in ("byteOffset", "byteLength")} | {"buffer": 0}
    stream |= {"byteStride": 16, "count": 4, "mode": "ATTRIBUTES", "filter": "EXPONENTIAL"}
    builder.root["bufferViews"][at] = {"buffer": 1, "byteLength": 64, "extensions": {"EXT_meshopt_compression": stream}}
    item = {"bufferView": at, "componentType": 5126, "count": 4, "type": "VEC4"}
    builder.root["accessors"].append(item)
    builder.root["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = len(builder.root["accessors"]) - 1
    asset = load_asset(builder.glb())
    written = position(asset.replace(asset.surface.positions), name="WEIGHTS_0")
    np.testing.assert_allclose(written, weights, atol=2e-3)
    np.testing.assert_allclose(written.astype(np.float64).sum(axis=1), 1.0, atol=4e-7, rtol=0)


def test_meshopt_with_plain_data_beside_it_is_read_plain_and_left_alone() -> None:
    asset = load_asset(meshopt_asset(fallback=True).glb())
    np.testing.assert_array_equal(asset.surface.positions, QUAD_VERTS)
    np.testing.assert_array_equal(asset.surface.triangles, QUAD_FACES)
    root, _, _ = unpack(asset.replace(asset.surface.positions * 2))
    assert root["extensionsUsed"] == ["EXT_meshopt_compression"]
    assert "extensions" in root["bufferViews"][0]


@each_case(
    ("member", "value", "error"),
    [
        ("buffer", 1, AssetTruncatedError),
        ("byteOffset", 10**6, AssetTruncatedError),
        ("byteLength", 20, AssetError),
        ("count", 5, AssetError),
        ("byteStride", 6, AssetError),
        ("mode", "NEW", AssetError),
        ("filter", "NEW", AssetError),
    ],
)
def test_a_broken_meshopt_view_is_told(member: str, value: Any, error: type[AssetError]) -> None:
    builder = meshopt_asset()
    builder.root["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][member] = value
    with pytest.raises(error):
        load_asset(builder.glb())


def test_what_compressed_parts_decode_to_has_a_limit() -> None:
    builder = meshopt_asset()
    view = builder.root["bufferViews"][0]
    view["byteLength"] = 12 * 10**9
    view["extensions"]["EXT_meshopt_compression"]["count"] = 10**9
    builder.root["buffers"][0]["byteLength"] = 12 * 10**9
    with pytest.raises(AssetTooLargeError, match="decodes to"):
        load_asset(builder.glb(), limits=Limits())
