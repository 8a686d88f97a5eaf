"""What becomes of every extension of docs/extensions.md: a file of each, and of each promise with a mechanism."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.assets import Asset, load_asset
from meshdeform.assets.extensions import RULES, Rule, rule_of
from meshdeform.errors import AssetError
from meshdeform.geometry.shapes import icosphere
from tests.unit.assets.builders import Builder, notable, pack, unpack

STRETCH = np.diag([1.0, 2.0, 1.0])
SHIFT = np.array([0.0, 1.0, 0.0])
NAMES = [name for rule in RULES for name in rule.names]
BALL = icosphere(2)


def ball(**node: Any) -> Builder:
    """Return a ball of radius 1 about the origin, shown by one node."""
    builder = Builder()
    builder.node(builder.mesh(builder.primitive(BALL.verts, BALL.faces.astype(np.uint16))), **node)
    return builder


def taller(asset: Asset, *, follow: bool = True, **options: Any) -> dict[str, Any]:
    """Return the JSON of an asset twice as tall: y' = 2 y + 1."""
    return unpack(taller_glb(asset, follow=follow, **options))[0]


def taller_glb(asset: Asset, *, follow: bool = True, **options: Any) -> bytes:
    positions = asset.surface.positions @ STRETCH + SHIFT
    jacobians = np.tile(STRETCH, (len(positions), 1, 1)) if follow else None
    return asset.replace(positions, jacobians=jacobians, **options)


def used(builder: Builder, *names: str, required: bool = False) -> Asset:
    builder.root["extensionsUsed"] = list(names)
    if required:
        builder.root["extensionsRequired"] = list(names)
    return load_asset(builder.glb())


def heights(root: dict[str, Any], mesh: int) -> list[tuple[float, float]]:
    accessors = root["accessors"]
    numbers = [each["attributes"]["POSITION"] for each in root["meshes"][mesh]["primitives"]]
    return [(accessors[at]["min"][1], accessors[at]["max"][1]) for at in numbers]


def cells(rule: Rule) -> list[str]:
    return [name for name, cell in (("kept", rule.kept), ("told", rule.told), ("refused", rule.refused)) if cell]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_of_each_extension_becomes_what_its_row_says(name: str) -> None:
    rule = rule_of(name)
    assert rule is not None
    assert cells(rule)
    asset = used(ball(), name)
    told = [text for text in notable(asset) if name in text]
    assert bool(told) == bool(rule.told and rule.when is None)
    decoded = "compression" in name and not rule.refused  # nothing is compressed any more
    assert taller(asset).get("extensionsUsed") == (None if decoded else [name])
    if rule.refused:
        with pytest.raises(AssetError, match=name):
            used(ball(), name, required=True)
    else:
        assert used(ball(), name, required=True).summary.extensions == (name,)


def test_each_extension_has_one_row() -> None:
    assert len(NAMES) == len(set(NAMES))


def test_an_unknown_extension_is_told_and_refused_if_required() -> None:
    assert any("OTHER_thing: not known" in text for text in notable(used(ball(), "OTHER_thing")))
    with pytest.raises(AssetError, match="OTHER_thing"):
        used(ball(), "OTHER_thing", required=True)
    assert notable(used(ball(), "KHR_materials_of_tomorrow", required=True)) == ()


# ---------------------------------------------------------------- accessors and copies


def manifold(*, shared: bool = True) -> Builder:
    builder = Builder()
    half = len(BALL.faces) // 2
    first = builder.primitive(BALL.verts, BALL.faces[:half].astype(np.uint16))
    rest = builder.accessor(BALL.faces[half:].reshape(-1).astype(np.uint16))
    positions = first["attributes"]["POSITION"] if shared else builder.accessor(np.float32(BALL.verts), bounds=True)
    second = {"attributes": {"POSITION": positions}, "indices": rest}
    mesh = builder.mesh(first, second)
    solid = {"attributes": dict(first["attributes"]), "indices": builder.accessor(BALL.faces.reshape(-1).astype("u2"))}
    builder.root["meshes"][mesh]["extensions"] = {"EXT_mesh_manifold": {"manifoldPrimitive": solid}}
    builder.node(mesh)
    return builder


@pytest.mark.parametrize("compact", [False, True])
def test_the_solid_of_a_manifold_mesh_shares_the_positions(compact: bool) -> None:
    asset = used(manifold(), "EXT_mesh_manifold")
    assert notable(asset) == ()
    root = taller(asset, compact=compact)
    mesh = root["meshes"][0]
    solid = mesh["extensions"]["EXT_mesh_manifold"]["manifoldPrimitive"]
    assert {each["attributes"]["POSITION"] for each in mesh["primitives"]} == set(solid["attributes"].values())
    assert heights(root, 0) == [(-1.0, 3.0)] * 2
    assert root["accessors"][solid["indices"]]["count"] == BALL.faces.size


def test_the_solid_goes_where_primitives_do_not_share_or_are_split() -> None:
    asset = used(manifold(shared=False), "EXT_mesh_manifold")
    assert any("do not share their positions" in text for text in notable(asset))
    root = taller(asset)
    assert "extensionsUsed" not in root
    assert "extensions" not in root["meshes"][0]
    builder = manifold()
    builder.root["nodes"][0]["scale"] = [1, 30, 1]
    finer, done = used(builder, "EXT_mesh_manifold").subdivided(10_000)
    assert done.dropped == ("EXT_mesh_manifold",)
    assert "extensionsUsed" not in unpack(finer.to_bytes())[0]


def smiling_twice() -> Builder:
    """Return a ball with a morph target on two nodes."""
    builder = ball(translation=[-2, 0, 0])
    target = {"POSITION": builder.accessor(np.float32(BALL.verts * 0.1), bounds=True)}
    builder.root["meshes"][0] |= {"weights": [0.0]}
    builder.root["meshes"][0]["primitives"][0]["targets"] = [target]
    builder.node(0, translation=[2, 0, 0])
    return builder


@pytest.mark.parametrize("morph", [False, True])
def test_a_pointer_to_a_mesh_acts_on_all_its_copies(morph: bool) -> None:
    builder = smiling_twice()
    times, weights = builder.accessor(np.float32([0, 1])), builder.accessor(np.float32([0, 1]))
    pointer = {"KHR_animation_pointer": {"pointer": "/meshes/0/weights"}}
    channel = {"sampler": 0, "target": {"path": "pointer", "extensions": pointer}}
    builder.root["animations"] = [{"samplers": [{"input": times, "output": weights}], "channels": [channel]}]
    asset = used(builder, "KHR_animation_pointer")
    root = unpack(asset.replace(asset.surface.positions * 2, morph=morph))[0]
    named = [
        each["target"]["extensions"]["KHR_animation_pointer"]["pointer"] for each in root["animations"][0]["channels"]
    ]
    assert sorted(named) == [f"/meshes/{node['mesh']}/weights" for node in root["nodes"]]
    for each in root["animations"][0]["channels"]:
        sampler = root["animations"][0]["samplers"][each["sampler"]]
        assert root["accessors"][sampler["output"]]["count"] == (4 if morph else 2)


def test_expressions_and_first_person_rules_of_vrm_0_name_all_copies() -> None:
    builder = smiling_twice()
    group = {"name": "joy", "binds": [{"mesh": 0, "index": 0, "weight": 100}]}
    rules = {"meshAnnotations": [{"mesh": 0, "firstPersonFlag": "Auto"}]}
    builder.root["extensions"] = {"VRM": {"blendShapeMaster": {"blendShapeGroups": [group]}, "firstPerson": rules}}
    avatar = taller(used(builder, "VRM"))["extensions"]["VRM"]
    binds = avatar["blendShapeMaster"]["blendShapeGroups"][0]["binds"]
    assert binds == [{"mesh": mesh, "index": 0, "weight": 100} for mesh in (0, 1)]
    assert [each["mesh"] for each in avatar["firstPerson"]["meshAnnotations"]] == [0, 1]


@pytest.mark.parametrize("extras", [{"meshIndex": 0}, {"unity": {"lodMeshes": [0, 1]}}])
def test_extras_that_number_copied_meshes_are_told(extras: dict[str, Any]) -> None:
    builder = smiling_twice()
    builder.root["extras"] = extras
    assert any("Extras name meshes by number" in text for text in notable(used(builder)))
    alone = ball(extras={**extras, "gd_script": "res://a.gd"})
    assert notable(used(alone)) == ()


def test_graphs_that_may_point_to_copied_meshes_are_told() -> None:
    assert any("KHR_interactivity" in text for text in notable(used(smiling_twice(), "KHR_interactivity")))


# ---------------------------------------------------------------- levels of detail


def levels(**lower: Any) -> Builder:
    """Return a group with a ball, and a coarser ball in its place that the scene does not show."""
    builder = Builder()
    coarse, fine = icosphere(1), icosphere(3)
    for each in (fine, coarse):
        builder.mesh(builder.primitive(each.verts, each.faces.astype(np.uint16), NORMAL=np.float32(each.verts)))
    builder.node(0, in_scene=False, name="lod0", extensions={"MSFT_lod": {"ids": [1]}})
    builder.node(1, in_scene=False, name="lod1", **lower)
    builder.node(None, children=[0], translation=[5, 0, 0])
    return builder


@pytest.mark.parametrize("follow", [True, False])
@pytest.mark.parametrize("lower", [{}, {"rotation": [0, 0, 1, 0], "scale": [0.9, 0.9, 0.9]}])
def test_levels_of_detail_are_deformed_alike(follow: bool, lower: dict[str, Any]) -> None:
    asset = used(levels(**lower), "MSFT_lod")
    assert notable(asset) == ()
    data = taller_glb(asset, follow=follow)
    root = unpack(data)[0]
    # The coarse level alone, in the place of the fine one, has the new shape of what it was.
    root["scenes"][0]["nodes"] = [2]
    root["nodes"][2]["children"] = [1]
    size = lower.get("scale", [1.0])[0]
    shown = load_asset(pack(root, *unpack(data)[1:2])).surface
    place = root["nodes"][2]["translation"]
    expected = icosphere(1).verts * ([-size, -size, size] if lower else [1, 1, 1])
    np.testing.assert_allclose(shown.positions - place, expected @ STRETCH + SHIFT, atol=1e-6 if follow else 0.05)
    turned = expected / [1, 2, 1]
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    np.testing.assert_allclose(shown.normals, turned, atol=1e-6 if follow else 0.05)


def test_levels_that_cannot_be_read_are_told_and_stay() -> None:
    builder = levels()
    number = builder.root["meshes"][1]["primitives"][0]["attributes"]["POSITION"]
    view = builder.root["bufferViews"][builder.root["accessors"][number]["bufferView"]]
    at = view["byteOffset"]
    builder.binary = builder.binary[:at] + np.float32([np.nan]).tobytes() + builder.binary[at + 4 :]
    asset = used(builder, "MSFT_lod")
    assert any("Levels of detail and colliders stay as they are" in text for text in notable(asset))
    assert taller(asset)["meshes"][1] == builder.root["meshes"][1]


# ---------------------------------------------------------------- colliders

SHAPES = "KHR_implicit_shapes"
BODIES = "KHR_physics_rigid_bodies"


def solid(
    shape: dict[str, Any], node: dict[str, Any] | None = None, *, lists: str = SHAPES, by: str = BODIES
) -> Builder:
    """Return a ball whose node, or another one in its middle, has an implicit shape."""
    body = {"collider": {"geometry": {"shape": 0}} if by == BODIES else {"shape": 0}}
    builder = ball(**({} if node else {"extensions": {by: {"motion": {"mass": 2}, **body}}}))
    if node:
        builder.node(None, **node, extensions={by: body})
    builder.root["extensions"] = {lists: {"shapes": [shape]}}
    return builder


@pytest.mark.parametrize(
    ("shape", "grown"),
    [
        ({"type": "box", "box": {"size": [2, 2, 2]}}, {"type": "box", "box": {"size": [2, 4, 2]}}),
        ({"type": "sphere", "sphere": {"radius": 1}}, {"type": "sphere", "sphere": {"radius": 2 ** (1 / 3)}}),
        ({"capsule": {"height": 1, "radiusTop": 0.5}}, {"capsule": {"height": 2, "radiusTop": 0.5}}),
        ({"cylinder": {"height": 1, "radius": 0.5}}, {"cylinder": {"height": 2, "radius": 0.5}}),
    ],
)
@pytest.mark.parametrize(("lists", "by"), [(SHAPES, BODIES), ("OMI_physics_shape", "OMI_physics_body")])
def test_an_implicit_shape_grows_and_goes_with_its_place(
    shape: dict[str, Any], grown: dict[str, Any], lists: str, by: str
) -> None:
    root = taller(used(solid(shape, {"translation": [0, 0.5, 0]}, lists=lists, by=by), lists, by))
    holder = root["nodes"][1]["extensions"][by]["collider"]
    number = holder.get("geometry", holder)["shape"]
    new = root["extensions"][lists]["shapes"][number]
    for kind, sizes in grown.items():
        for name, value in sizes.items() if isinstance(sizes, dict) else ():
            assert new[kind][name] == pytest.approx(value)
    assert root["extensions"][lists]["shapes"][0] == shape
    np.testing.assert_allclose(root["nodes"][1]["translation"], [0, 2, 0], atol=1e-6)


def test_the_shape_of_a_node_that_stays_gets_a_node_of_its_own() -> None:
    root = taller(used(solid({"type": "box", "box": {"size": [2, 2, 2]}}), SHAPES, BODIES))
    assert root["nodes"][0]["extensions"][BODIES] == {"motion": {"mass": 2}}
    child = root["nodes"][root["nodes"][0]["children"][0]]
    np.testing.assert_allclose(child["translation"], SHIFT, atol=1e-6)
    number = child["extensions"][BODIES]["collider"]["geometry"]["shape"]
    assert root["extensions"][SHAPES]["shapes"][number]["box"]["size"] == pytest.approx([2, 4, 2])
    kept = taller(used(solid({"type": "box", "box": {"size": [2, 2, 2]}}), SHAPES, BODIES), follow=False)
    assert kept["extensions"][SHAPES]["shapes"] == [{"type": "box", "box": {"size": [2, 2, 2]}}]


@pytest.mark.parametrize("form", ["mesh", "node", "shape"])
def test_meshes_that_collide_are_deformed_alike(form: str) -> None:
    builder = ball()
    hull = icosphere(1)
    builder.mesh(builder.primitive(hull.verts * 1.01, hull.faces.astype(np.uint16)))
    geometry: dict[str, Any] = {"mesh": 1, "convexHull": True}
    if form == "node":
        geometry = {"node": builder.node(1, in_scene=False)}
    if form == "shape":
        builder.root["extensions"] = {"KHR_collision_shapes": {"shapes": [{"type": "trimesh", "trimesh": {"mesh": 1}}]}}
        geometry = {"shape": 0}
    builder.root["nodes"][0]["extensions"] = {BODIES: {"collider": {"geometry": geometry}}}
    root = taller(used(builder, BODIES))
    assert heights(root, 1)[0] == pytest.approx((-1.02, 3.02), abs=1e-5)


def test_two_nodes_with_one_colliding_mesh_get_one_each() -> None:
    builder = ball(translation=[-2, 0, 0])
    builder.mesh(builder.primitive(BALL.verts, BALL.faces.astype(np.uint16)))
    builder.node(0, translation=[2, 0, 0])
    for node in builder.root["nodes"]:
        node["extensions"] = {BODIES: {"collider": {"geometry": {"mesh": 1}}}}
    asset = used(builder, BODIES)
    right = asset.surface.positions[:, :1] > 0
    moved = np.where(right, asset.surface.positions * [1, 3, 1], asset.surface.positions)
    root = unpack(asset.replace(moved))[0]
    named = [node["extensions"][BODIES]["collider"]["geometry"]["mesh"] for node in root["nodes"]]
    assert [heights(root, mesh)[0][1] for mesh in named] == pytest.approx([1, 3], abs=0.05)


# ---------------------------------------------------------------- avatars


def avatar(**extensions: Any) -> Asset:
    """Return a ball with a head bone in it, and the extensions of an avatar."""
    builder = ball()
    builder.node(None, name="head", translation=[0, 0.5, 0])
    builder.root["extensions"] = extensions
    return used(builder, *extensions)


def test_the_numbers_of_an_avatar_of_vrm_1_go_with_its_surface() -> None:
    head = {"humanoid": {"humanBones": {"head": {"node": 1}}}, "lookAt": {"offsetFromHeadBone": [0, 0.2, 0.3]}}
    plane = {"shape": {"plane": {"offset": [0, 0.1, 0], "normal": [0, 1, 0]}}}
    spring = {
        "colliders": [
            {"node": 1, "shape": {"sphere": {"offset": [0, 0.1, 0], "radius": 0.1}}},
            {"node": 1, "shape": {"capsule": {"offset": [0, 0, 0], "radius": 0.1, "tail": [0, -0.2, 0]}}},
            {"node": 1, "shape": {}, "extensions": {"VRMC_springBone_extended_collider": plane}},
        ],
        "springs": [{"joints": [{"node": 1, "hitRadius": 0.02}]}],
    }
    root = taller(avatar(VRMC_vrm=head, VRMC_springBone=spring))
    new = root["extensions"]
    assert new["VRMC_vrm"]["lookAt"]["offsetFromHeadBone"] == pytest.approx([0, 0.4, 0.3], abs=1e-6)
    sphere, capsule, extended = new["VRMC_springBone"]["colliders"]
    assert sphere["shape"]["sphere"]["offset"] == pytest.approx([0, 0.2, 0], abs=1e-6)
    assert sphere["shape"]["sphere"]["radius"] == pytest.approx(0.1 * 2 ** (1 / 3))
    assert capsule["shape"]["capsule"]["tail"] == pytest.approx([0, -0.4, 0], abs=1e-6)
    shape = extended["extensions"]["VRMC_springBone_extended_collider"]["shape"]
    assert shape["plane"]["offset"] == pytest.approx([0, 0.2, 0], abs=1e-6)
    assert new["VRMC_springBone"]["springs"][0]["joints"][0]["hitRadius"] == pytest.approx(0.02 * 2 ** (1 / 3))


def test_offsets_of_vrm_0_have_the_z_axis_of_unity() -> None:
    springs = {"colliderGroups": [{"node": 1, "colliders": [{"offset": {"x": 0, "y": 0.1, "z": 0.8}, "radius": 0.1}]}]}
    bones = [{"bone": "head", "node": 1}]
    first = {"firstPersonBone": -1, "firstPersonBoneOffset": {"x": 0, "y": 0.1, "z": 0.8}}
    asset = avatar(VRM={"humanoid": {"humanBones": bones}, "firstPerson": first, "secondaryAnimation": springs})
    # What is in front of the head in glTF, +Z, is -z in Unity: only that side grows.
    positions = asset.surface.positions.copy()
    ahead = positions[:, 2] > 0
    positions[ahead] *= [1, 1, 3]
    maps = np.tile(np.eye(3), (len(positions), 1, 1))
    maps[ahead] = np.diag([1, 1, 3])
    new = unpack(asset.replace(positions, jacobians=maps))[0]["extensions"]["VRM"]
    behind = new["firstPerson"]["firstPersonBoneOffset"]
    assert new["secondaryAnimation"]["colliderGroups"][0]["colliders"][0]["offset"] == behind
    front = {"humanoid": {"humanBones": bones}, "firstPerson": {"firstPersonBoneOffset": {"x": 0, "y": 0.1, "z": -0.8}}}
    grown = unpack(avatar(VRM=front).replace(positions, jacobians=maps))[0]["extensions"]["VRM"]["firstPerson"]
    assert grown["firstPersonBoneOffset"]["z"] < -1.6 < 0.6 < behind["z"] < 1.3


@pytest.mark.parametrize(
    ("name", "meta", "told"),
    [
        ("VRMC_vrm", {"modification": "prohibited"}, True),
        ("VRMC_vrm", {"modification": "allowModification"}, False),
        ("VRM", {"licenseName": "CC_BY_NC_ND"}, True),
        ("VRM", {"licenseName": "CC0"}, False),
    ],
)
def test_a_licence_that_forbids_changes_is_told(name: str, meta: dict[str, Any], told: bool) -> None:
    assert any("forbids changes" in text for text in notable(avatar(**{name: {"meta": meta}}))) == told


# ---------------------------------------------------------------- the rest


def test_bounds_that_a_scene_states_are_computed_again() -> None:
    builder = ball()
    stated = {"vertexCount": 162, "sceneBounds": {"min": [-1, -1, -1], "max": [1, 1, 1]}}
    builder.root["scenes"][0]["extensions"] = {"FB_geometry_metadata": stated}
    new = taller(used(builder, "FB_geometry_metadata"))["scenes"][0]["extensions"]["FB_geometry_metadata"]
    assert new["vertexCount"] == 162
    assert (new["sceneBounds"]["min"][1], new["sceneBounds"]["max"][1]) == pytest.approx((-1, 3))


@pytest.mark.parametrize(("default", "words"), [(True, "the others stay"), (False, "names none as its default")])
def test_several_scenes_are_told(default: bool, words: str) -> None:
    builder = ball()
    builder.node(0, in_scene=False)
    builder.root["scenes"].append({"nodes": [1]})
    if not default:
        del builder.root["scene"]
    assert any(words in text for text in notable(used(builder)))
    assert notable(used(ball())) == ()


HOSTILE: list[Callable[[Builder], None]] = [
    lambda b: b.root["nodes"][0].update(extensions={"MSFT_lod": {"ids": [7, -1, "a", None, 0]}}),
    lambda b: b.root["nodes"][0].update(extensions={"MSFT_lod": {"ids": 3}}),
    lambda b: b.root["nodes"][0].update(extensions={BODIES: {"collider": {"geometry": {"shape": 9, "mesh": 9}}}}),
    lambda b: b.root["nodes"][0].update(extensions={BODIES: {"collider": [], "trigger": {"geometry": {"node": 99}}}}),
    lambda b: b.root.update(extensions={SHAPES: {"shapes": [1, {}]}, "VRM": [], "VRMC_vrm": {"lookAt": 1}}),
    lambda b: b.root.update(extensions={"VRMC_springBone": {"colliders": [{"node": 99, "shape": {"sphere": {}}}, 1]}}),
    lambda b: b.root.update(extensions={"VRM": {"firstPerson": {"firstPersonBoneOffset": {"x": "a"}}}}),
    lambda b: b.root["meshes"][0].update(extensions={"EXT_mesh_manifold": {"manifoldPrimitive": 3}}),
]


@pytest.mark.parametrize("spoil", HOSTILE)
def test_damaged_extensions_break_nothing(spoil: Callable[[Builder], None]) -> None:
    builder = ball()
    spoil(builder)
    assert heights(taller(used(builder)), 0) == [(-1.0, 3.0)]


def test_the_page_lists_every_extension(repository: Path) -> None:
    page = (repository / "docs/extensions.md").read_text()
    assert all(f"`{name}`" in page for name in NAMES)
