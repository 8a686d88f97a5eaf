"""Whatever is done to a file, loading it gives an asset or an `AssetError`, and takes no memory by its word."""

from __future__ import annotations

import json
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from meshdeform.assets import inspect_asset, load_asset
from meshdeform.errors import AssetError
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, Builder, pack, unpack
from tests.unit.assets.test_compressed import meshopt_asset
from tests.unit.assets.test_replace import rich

MAX_MEMORY = 32 * 2**20
quick = settings(max_examples=150, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def kitchen_sink() -> bytes:
    """One small file with a skin, instances, a sparse accessor, targets, an animation and a strip."""
    builder = rich()
    strip = {**builder.primitive(faces=np.arange(4, dtype=np.uint8)), "mode": 5}
    strip["targets"] = [{"POSITION": builder.accessor(QUAD_VERTS, bounds=True)}]
    weights = np.eye(4, dtype=np.float32)[[0] * 4]
    sparse = builder.primitive(NORMAL=QUAD_NORMALS, JOINTS_0=np.zeros((4, 4), np.uint8), WEIGHTS_0=weights)
    builder.root["accessors"][sparse["attributes"]["POSITION"]]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": builder.view(np.array([1, 3], np.uint16).tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(QUAD_VERTS[[1, 3]].tobytes())},
    }
    mesh = builder.mesh(strip, weights=[0.5])
    child = builder.node(mesh, in_scene=False, scale=[1, -1, 1])
    joint = builder.node(children=[child], rotation=[0, 0, 0, 1])
    builder.root["skins"] = [
        {"joints": [joint], "inverseBindMatrices": builder.accessor(np.eye(4, dtype=np.float32).reshape(1, 16))}
    ]
    builder.node(builder.mesh(sparse), skin=0)
    builder.node(0, matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1])
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    sampler = {"input": times, "output": builder.accessor(np.array([0, 1], np.float32))}
    channel = {"sampler": 0, "target": {"node": child, "path": "weights"}}
    builder.root["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    return builder.glb((b"XTRA", b"abcd"))


@pytest.fixture(scope="module")
def seeds() -> list[bytes]:
    quad = Builder()
    quad.node(quad.mesh(quad.primitive(faces=QUAD_FACES.astype(np.uint32))))
    return [quad.glb(), kitchen_sink(), meshopt_asset().glb()]


def survives(data: bytes, name: str = "") -> None:
    """Load a file and write it both ways; only `AssetError`s may come out, and little memory may go in."""
    tracemalloc.start()
    try:
        try:
            inspect_asset(data, name)
        except AssetError:
            with pytest.raises(AssetError):
                load_asset(data, name)
            return
        try:
            asset = load_asset(data, name)
        except AssetError:
            return
        surface = asset.surface
        for morph in (False, True):
            asset.replace(surface.positions, surface.normals, surface.tangents, morph=morph)
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < MAX_MEMORY


def test_the_seeds_themselves_load(seeds: list[bytes]) -> None:
    for seed in seeds:
        assert len(load_asset(seed).surface.triangles) >= 2


@quick
@given(st.integers(0, 2), st.data())
def test_bit_flips_and_cuts(seeds: list[bytes], which: int, data: st.DataObject) -> None:
    broken = bytearray(seeds[which])
    for _ in range(data.draw(st.integers(1, 6))):
        broken[data.draw(st.integers(0, len(broken) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    if data.draw(st.booleans()):
        del broken[data.draw(st.integers(0, len(broken))) :]
        # Let the cut pass the first check of lengths, so that the next ones have to find it.
        broken[8:12] = len(broken).to_bytes(4, "little")
    survives(bytes(broken))


odd = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-2, 8),
    st.sampled_from([2**31, 2**32, 2**53, 2**64, 10**400, -(2**40)]),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from(["", "VEC3", "data:,", "data:;base64,####", "x.bin", "\ud800"]),
    st.lists(st.integers(-1, 5), max_size=4),
    st.dictionaries(st.sampled_from(["a", "count", "bufferView"]), st.integers(-1, 5), max_size=2),
)


def places(value: Any, way: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """List the paths to everything inside a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, item in items for place in ((*way, key), *places(item, (*way, key)))]


@quick
@given(st.integers(0, 2), st.data())
def test_odd_values_in_the_json(seeds: list[bytes], which: int, data: st.DataObject) -> None:
    root, binary, _ = unpack(seeds[which])
    for _ in range(data.draw(st.integers(1, 2))):
        *way, last = data.draw(st.sampled_from(places(root)))
        parent = root
        for step in way:
            parent = parent[step]
        if data.draw(st.booleans()) and isinstance(parent, dict):
            del parent[last]
        else:
            parent[last] = data.draw(odd)
    survives(pack(json.dumps(root).encode(), binary))


@quick
@given(st.sampled_from(["a.obj", "a.ply", "a.stl", "a.glb", "a.gltf", ""]), st.binary(max_size=300))
def test_noise(name: str, data: bytes) -> None:
    survives(data, name)
