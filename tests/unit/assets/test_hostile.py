"""Files that are small and cost much: what grows with the square of the file is refused, or does not exist."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import container, inspect, inspect_asset, load_asset, scene_checks, storage_checks
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetTooLargeError
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_NORMALS, Builder, pack, unpack


def builder() -> Builder:
    made = Builder()
    made.node(made.mesh(made.primitive()))
    return made


def many_images(made: Builder, count: int) -> None:
    made.root["images"] = [{"bufferView": 0} for _ in range(count)]


def many_views(made: Builder, count: int) -> None:
    made.root["bufferViews"] += [{"buffer": 0, "byteLength": 1} for _ in range(count)]


def many_accessors(made: Builder, count: int) -> None:
    made.root["accessors"] += [copy.deepcopy(made.root["accessors"][0]) for _ in range(count)]


def many_skins(made: Builder, count: int) -> None:
    made.root["skins"] = [{"joints": [0]} for _ in range(count)]


@each_case("fill", [many_images, many_views, many_accessors, many_skins])
def test_checks_look_at_each_array_a_few_times_only(
    fill: Callable[[Builder, int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at = 0
    real = container.objects

    def counting(parent: dict[str, Any], key: str, where: str = "") -> list[dict[str, Any]]:
        nonlocal looked_at
        found = real(parent, key, where)
        looked_at += len(found)
        return found

    for module in (inspect, scene_checks, storage_checks):
        monkeypatch.setattr(module, "objects", counting)
    made = builder()
    fill(made, 1000)
    many_views(made, 1000)
    many_accessors(made, 1000)
    inspect_asset(made.glb())
    assert 2_000 < looked_at < 50_000


def primitives_of_many_nodes(made: Builder) -> None:
    made.root["meshes"][0]["primitives"] += [{"mode": 0}] * 100
    for _ in range(50):
        made.node(0)


def targets_of_many_primitives(made: Builder) -> None:
    primitives = made.root["meshes"][0]["primitives"]
    primitives[0]["targets"] = [{}] * 100
    primitives += [made.primitive() for _ in range(100)]


def weights_of_many_nodes(made: Builder) -> None:
    made.root["meshes"][0]["weights"] = [0.0] * 500
    made.node(0)
    made.node(0)


@each_case("fill", [primitives_of_many_nodes, targets_of_many_primitives, weights_of_many_nodes])
def test_what_multiplies_has_a_limit(fill: Callable[[Builder], None]) -> None:
    made = builder()
    fill(made)
    with pytest.raises(AssetTooLargeError, match="1000 primitives and morph targets"):
        inspect_asset(made.glb(), limits=Limits(max_primitives=1000))
    glb = builder().glb(*[(b"XTRA", b"")] * 20)
    inspect_asset(glb, limits=Limits(max_chunks=30))
    with pytest.raises(AssetTooLargeError, match="more than 10 chunks"):
        inspect_asset(glb, limits=Limits(max_chunks=10))


def test_animations_that_share_an_output_share_the_grown_one() -> None:
    root, binary, _ = unpack(animated({"node": 0, "path": "weights"}))
    (animation,) = root["animations"]
    animation["samplers"] *= 50
    animation["channels"] = [{**animation["channels"][0], "sampler": i} for i in range(50)]
    asset = load_asset(pack(root, binary))
    root, _, _ = unpack(asset.replace(asset.surface.positions + 1.0, morph=True))
    grown = {root["animations"][0]["samplers"][c["sampler"]]["output"] for c in root["animations"][0]["channels"]}
    assert len(grown) == 1
    assert root["accessors"][grown.pop()]["count"] == 4


def animated(target: Any, animations: Any = None) -> bytes:
    made = Builder()
    primitive = made.primitive(NORMAL=QUAD_NORMALS)
    primitive["targets"] = [{"NORMAL": primitive["attributes"]["NORMAL"]}]
    made.node(made.mesh(primitive, weights=[0.0]))
    times = made.accessor(np.array([0, 1], np.float32), bounds=True)
    sampler = {"input": times, "output": made.accessor(np.array([0, 0.5], np.float32))}
    made.root["animations"] = animations or [{"samplers": [sampler], "channels": [{"sampler": 0, "target": target}]}]
    return made.glb()


def pointer(to: str) -> dict[str, Any]:
    return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": to}}}


@each_case(
    "target",
    [{"path": "weights", "node": odd} for odd in ({}, [], None, "0", 0.0, True, 7)]
    + [pointer(f"/{kind}/{number}/weights") for kind in ("nodes", "meshes") for number in ("7", "9" * 5000)],
)
def test_an_animation_of_something_else_is_left_alone(target: dict[str, Any]) -> None:
    asset = load_asset(animated(target))
    root, _, _ = unpack(asset.replace(asset.surface.positions + 1.0, morph=True))
    assert root["animations"][0]["channels"] == [{"sampler": 0, "target": target}]


@each_case("animations", [{"a": 1}, 3, "x", [3], [[]], [None]])
def test_animations_that_are_none_are_refused_before_a_job_computes(animations: Any) -> None:
    with pytest.raises(AssetError, match="animations must be an array of objects"):
        inspect_asset(animated({}, animations))
