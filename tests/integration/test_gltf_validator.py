"""The Khronos validator finds no new error in what we write."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from meshdeform.assets import load_asset
from meshdeform.assets.parted import PartsAs, with_parts
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import QUAD_NORMALS, Builder
from tests.unit.assets.test_archive import scene
from tests.unit.assets.test_carried import mixed
from tests.unit.assets.test_compact import ASSETS as COMPACTED
from tests.unit.assets.test_compact import written as deformed
from tests.unit.assets.test_compressed import draco_asset, draco_skin, draco_stream, meshopt_asset
from tests.unit.assets.test_convert import OBJ, PLY, stl
from tests.unit.assets.test_fuzz import kitchen_sink
from tests.unit.assets.test_morph import with_targets
from tests.unit.assets.test_parted import ASSETS as PARTED
from tests.unit.assets.test_parted import halves
from tests.unit.assets.test_replace import rich, text_gltf
from tests.unit.assets.test_rig import arm

Validate = Callable[[bytes], dict[str, Any]]


def errors(report: dict[str, Any]) -> Counter[str]:
    return Counter(issue["code"] for issue in report["issues"]["messages"] if issue["severity"] == 0)


def normals_only() -> Builder:
    builder = Builder()
    builder.node(builder.mesh(builder.primitive(NORMAL=QUAD_NORMALS)))
    builder.node(0, translation=[3, 0, 0], scale=[1, -2, 1])
    return builder


def animated_weights() -> Builder:
    builder = with_targets(2)
    node = builder.node(0)
    builder.root["meshes"][0]["primitives"].append({**builder.primitive(), "targets": [{}, {}], "mode": 0})
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    sampler = {"input": times, "output": builder.accessor(np.array([0, 0.5, 1, 0.25], np.float32))}
    channel = {"sampler": 0, "target": {"node": node, "path": "weights"}}
    builder.root["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    return builder


ASSETS: dict[str, Callable[[], tuple[bytes, str]]] = {
    "rich": lambda: (rich().glb(), ""),
    "instances": lambda: (normals_only().glb(), ""),
    "skin, strip, sparse, targets": lambda: (kitchen_sink(), ""),
    "animated weights": lambda: (animated_weights().glb(), ""),
    "draco": lambda: (draco_asset(draco_stream()).glb(), ""),
    "draco with a skin": lambda: (draco_skin().glb(), ""),
    "data uris": lambda: (text_gltf(), "a.gltf"),
    "meshopt": lambda: (meshopt_asset().glb(), ""),
    "points and lines": lambda: (mixed().glb(), ""),
    "a gltf with its files": lambda: (packed(scene()), "scene.zip"),
    "obj": lambda: (OBJ, "a.obj"),
    "ply": lambda: (PLY, "a.ply"),
    "stl": lambda: (stl(), "a.stl"),
}


@each_case("compact", [False, True])
def test_a_rig_that_follows_has_no_new_error(validate_glb: Validate, compact: bool) -> None:
    asset = load_asset(arm(targets=True).glb())
    surface = asset.surface
    jacobians = np.tile(np.diag([1.5, 1.0, 1.5]), (len(surface.positions), 1, 1))
    written = asset.replace(surface.positions * [1.5, 1.0, 1.5], jacobians=jacobians, compact=compact)
    assert not errors(validate_glb(written)) - errors(validate_glb(asset.to_bytes()))


@each_case("name", list(ASSETS))
@each_case("morph", [False, True])
@each_case("compact", [False, True])
def test_no_new_error(validate_glb: Validate, name: str, morph: bool, compact: bool) -> None:
    data, filename = ASSETS[name]()
    asset = load_asset(data, filename)
    surface = asset.surface
    moved = surface.positions + np.sin(surface.positions[:, [1, 2, 0]])
    written = asset.replace(moved, surface.normals[:, [1, 2, 0]], surface.tangents, morph=morph, compact=compact)
    report = validate_glb(written)
    assert not errors(report) - errors(validate_glb(asset.to_bytes()))
    assert "DATA_URI_GLB" not in {issue["code"] for issue in report["issues"]["messages"]}


@each_case("name", ["interleaved", "quantized", "embedded"])
def test_a_compact_result_has_no_issue_that_the_source_has_not(validate_glb: Validate, name: str) -> None:
    source = COMPACTED[name]()
    before, after = (validate_glb(data)["issues"]["messages"] for data in (source, deformed(source, compact=True)))
    assert Counter(issue["code"] for issue in after) <= Counter(issue["code"] for issue in before)


def serious(report: dict[str, Any]) -> Counter[str]:
    return Counter(issue["code"] for issue in report["issues"]["messages"] if issue["severity"] <= 1)


@each_case("name", list(ASSETS))
def test_a_subdivided_asset_has_no_new_error_or_warning(validate_glb: Validate, name: str) -> None:
    data, filename = ASSETS[name]()
    asset = load_asset(data, filename)
    made, done = asset.subdivided(20_000)
    assert done.split
    moved = made.surface.positions + np.sin(made.surface.positions[:, [1, 2, 0]])
    known = serious(validate_glb(asset.to_bytes()))
    for written in (made.to_bytes(), made.replace(moved, made.surface.normals, made.surface.tangents, morph=True)):
        assert not serious(validate_glb(written)).keys() - known.keys()


@each_case("form", list(PartsAs))
@each_case("name", list(PARTED))
def test_an_asset_with_its_parts_has_no_new_error_or_warning(validate_glb: Validate, name: str, form: PartsAs) -> None:
    asset = load_asset(*PARTED[name])
    known = serious(validate_glb(asset.to_bytes()))
    if form is PartsAs.NODES:  # viewers ignore the place of a skin's node; a child's is that of its node
        known["NODE_SKINNED_MESH_NON_ROOT"] += 1
    assert not serious(validate_glb(with_parts(asset, halves(asset), form))).keys() - known.keys()
