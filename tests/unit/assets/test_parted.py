"""An asset with its parts shows what it did, and has everything that it had; its parts are read back."""

from __future__ import annotations

import base64
import io
from collections import Counter
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image as Picture

from meshdeform.assets import load_asset
from meshdeform.assets.accessors import read_accessor, read_triangles
from meshdeform.assets.asset import Asset
from meshdeform.assets.build import Primitive, build_glb
from meshdeform.assets.container import dump_json
from meshdeform.assets.parted import PartLabels, PartsAs, parts_of, with_parts
from meshdeform.assets.placement import world_matrices
from meshdeform.errors import AssetError, ShapeError
from tests.cases import each_case
from tests.unit.assets.archives import packed
from tests.unit.assets.builders import QUAD_FACES, QUAD_VERTS, Builder, quad, unpack
from tests.unit.assets.test_archive import scene
from tests.unit.assets.test_carried import mixed
from tests.unit.assets.test_compressed import draco_asset, draco_skin, draco_stream, meshopt_asset
from tests.unit.assets.test_convert import OBJ, PLY, stl
from tests.unit.assets.test_fuzz import kitchen_sink
from tests.unit.assets.test_replace import rich, text_gltf
from tests.unit.assets.test_rig import arm

FORMS = list(PartsAs)
_LENGTH = 9


def _ladder() -> tuple[NDArray[Any], NDArray[Any]]:
    """Vertices and faces of a strip of quads along X."""
    x = np.arange(_LENGTH + 1)
    low, high = (np.stack([x, 0 * x + y, 0.1 * x], 1) for y in (0, 1))
    a = np.arange(_LENGTH)
    b = a + _LENGTH + 1
    faces = np.concatenate([np.stack([a, a + 1, b], 1), np.stack([b, a + 1, b + 1], 1)])
    return np.concatenate([low, high]).astype(np.float32), faces.astype(np.uint16)


def character() -> Builder:
    """A mesh with a skin, two morph targets and points, shown again twice without the skin, and much beside it."""
    builder = Builder()
    verts, faces = _ladder()
    count = len(verts)
    rng = np.random.default_rng(5)
    joints = np.zeros((count, 4), np.uint8)
    joints[:, 1] = 1
    upper = np.rint(255 * verts[:, 0] / _LENGTH).astype(np.uint8)
    skin = builder.primitive(
        verts,
        faces[:_LENGTH],
        NORMAL=np.tile(np.array([0, 0, 1], np.float32), (count, 1)),
        TEXCOORD_0=rng.random((count, 2)).astype(np.float32),
        COLOR_0=rng.integers(0, 256, (count, 4)).astype(np.uint8),
        JOINTS_0=joints,
        WEIGHTS_0=np.stack([255 - upper, upper, 0 * upper, 0 * upper], 1),
        _TEMPERATURE=rng.random(count).astype(np.float32),
    )
    for name in ("COLOR_0", "WEIGHTS_0"):
        builder.root["accessors"][skin["attributes"][name]]["normalized"] = True
    nothing = {"componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0]}
    builder.root["accessors"].append(nothing)
    bulge = builder.accessor(rng.random((count, 3)).astype(np.float32), bounds=True)
    builder.root["accessors"].append(
        {
            **nothing,
            "max": [1, 1, 1],
            "sparse": {
                "count": 2,
                "indices": {"bufferView": builder.view(np.array([4, 13], np.uint16).tobytes()), "componentType": 5123},
                "values": {"bufferView": builder.view(np.ones((2, 3), np.float32).tobytes())},
            },
        }
    )
    zeros, sparse = bulge - 1, bulge + 1
    skin |= {"material": 0, "targets": [{"POSITION": bulge}, {"POSITION": sparse, "NORMAL": zeros}]}
    # The other half of the faces has the same vertices, and the points as well.
    cloth = {**skin, "indices": builder.accessor(faces[_LENGTH:].reshape(-1), view={"target": 34963})}
    del cloth["material"]
    points = {**skin, "mode": 0, "extras": {"of": "points"}}
    del points["indices"]
    mesh = builder.mesh(
        skin, cloth, points, name="Body", weights=[0.0, 0.0], extras={"targetNames": ["bulge", "smile"], "kept": [1]}
    )
    second = builder.node(name="Tip", in_scene=False, translation=[5, 0, 0])
    root = builder.node(name="Root", children=[second])
    body = builder.node(mesh, name="Person", skin=0, weights=[0.25, 0.5])
    builder.node(mesh, name="Statue", translation=[0, 5, 0], rotation=[0, 0, 0.6, 0.8])
    builder.node(mesh, name="Relief", translation=[0, 9, 0], camera=0, extensions={"X_socket": {"at": [1]}})
    binds = np.tile(np.eye(4, dtype=np.float32).reshape(1, 16), (2, 1))
    binds[1, 12] = -5
    builder.root["skins"] = [{"joints": [root, second], "inverseBindMatrices": builder.accessor(binds)}]
    builder.root["materials"] = [
        {"name": "Skin", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "doubleSided": True}
    ]
    picture = io.BytesIO()
    Picture.new("RGB", (2, 2), (200, 120, 90)).save(picture, "PNG")
    builder.root["images"] = [{"uri": f"data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}"}]
    builder.root["textures"] = [{"source": 0}]
    builder.root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}]
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    moved = builder.accessor(np.array([[5, 0, 0], [5, 1, 0]], np.float32))
    weights = builder.accessor(np.array([0, 0, 1, 0.5], np.float32))
    pulse = builder.accessor(np.array([1, 0.5], np.float32))
    pointers = [
        "/materials/0/pbrMetallicRoughness/roughnessFactor",
        f"/meshes/{mesh}/weights",
        f"/nodes/{body}/weights",
    ]
    builder.root["animations"] = [
        {
            "name": "wave",
            "samplers": [{"input": times, "output": each} for each in (moved, weights, pulse)],
            "channels": [
                {"sampler": 0, "target": {"node": second, "path": "translation"}},
                {"sampler": 1, "target": {"node": body, "path": "weights"}},
                *(
                    {
                        "sampler": 2 if "materials" in pointer else 1,
                        "target": {
                            "path": "pointer",
                            "extensions": {"KHR_animation_pointer": {"pointer": pointer}},
                        },
                    }
                    for pointer in pointers
                ),
            ],
        }
    ]
    builder.root["extensionsUsed"] = ["KHR_animation_pointer", "X_socket", "X_scene"]
    builder.root["extensions"] = {"X_scene": {"of": body}}
    return builder


def halves(asset: Asset, seed: int = 3) -> dict[str, NDArray[np.bool_]]:
    """Two parts in bands across the surface, so that both share vertices and a third of the triangles has none."""
    middle = asset.surface.positions[asset.surface.triangles].mean(1)[:, 0]
    band = np.floor(3 * (middle - middle.min()) / max(np.ptp(middle), 1e-9)).astype(int)
    band = (band + np.random.default_rng(seed).integers(0, 2, len(band)) * (np.arange(len(band)) % 5 == 0)) % 3
    return {"head": band == 1, "left leg": band == 2}


def drawn(glb: bytes, filename: str = "") -> Counter[bytes]:
    """Everything that shows a triangle, point or line, for each of them: what it has at its corners, and what acts."""
    asset = load_asset(glb, filename)
    document, root = asset._document, asset._document.root
    worlds = world_matrices(root["nodes"])
    shown: Counter[bytes] = Counter()
    for at, node in enumerate(root["nodes"]):
        mesh = root["meshes"][node["mesh"]] if "mesh" in node else {"primitives": []}
        placed = node["skin"] if "skin" in node else (worlds[at] + 0.0).tolist()
        instances = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
        about = [placed, instances, node.get("weights", mesh.get("weights")), acting(root, at, node)]
        for primitive in mesh["primitives"]:
            attributes = {k: v for k, v in sorted(primitive.get("attributes", {}).items()) if k != "_PART"}
            slots = [attributes, *primitive.get("targets", [])]
            if "POSITION" not in attributes:
                continue
            material = primitive.get("material")
            look = {**(root["materials"][material] if material is not None else {}), "name": ""}
            kept = primitive.keys() - {"attributes", "targets", "indices", "mode", "material", "extras"}
            rest = {name: primitive[name] for name in sorted(kept)}
            extras = primitive.get("extras", {})
            if isinstance(extras, dict):
                rest["extras"] = {name: value for name, value in extras.items() if name != "polygons"}
            loose = primitive.get("mode", 4) < 4
            about_it = dump_json({"": [*about, look, _acting(root, "materials", material), rest, loose]})
            columns = [read_accessor(document, slot[name]) for slot in slots for name in sorted(slot)]
            names = repr([sorted(slot) for slot in slots]).encode()
            count = len(columns[0])
            faces = np.arange(count)[:, None] if loose else read_triangles(document, primitive, count, "")
            for corners in faces:
                start = int(np.argmin(corners)) if loose else _first(columns, corners)
                turned = np.roll(corners, -start)
                shown[about_it + names + b"".join(column[turned].tobytes() for column in columns)] += 1
    return shown


def _first(columns: list[NDArray[Any]], corners: NDArray[Any]) -> int:
    """The corner that a triangle begins with, whatever its vertices' numbers are."""
    return min(range(3), key=lambda k: b"".join(column[corners[k]].tobytes() for column in columns))


def acting(root: dict[str, Any], at: int, node: dict[str, Any]) -> list[Any]:
    """What animations do to the weights of a node's mesh."""
    direct = [
        [a, channel["sampler"]]
        for a, animation in enumerate(root.get("animations", []))
        for channel in animation["channels"]
        if (channel["target"].get("node"), channel["target"]["path"]) == (at, "weights")
    ]
    return [direct, _acting(root, "nodes", at), _acting(root, "meshes", node.get("mesh"))]


def _acting(root: dict[str, Any], kind: str, number: int | None) -> list[Any]:
    pointers = [
        [a, channel["sampler"], channel["target"]["extensions"]["KHR_animation_pointer"]["pointer"]]
        for a, animation in enumerate(root.get("animations", []))
        for channel in animation["channels"]
        if channel["target"]["path"] == "pointer"
    ]
    prefix = f"/{kind}/{number}/"
    return sorted([a, sampler, text[len(prefix) :]] for a, sampler, text in pointers if text.startswith(prefix))


ASSETS: dict[str, tuple[bytes, str]] = {
    "character": (character().glb((b"XTRA", b"abcd")), ""),
    "rig": (arm(targets=True).glb(), ""),
    "skin, strip, sparse, targets": (kitchen_sink(), ""),
    "rich": (rich().glb(), ""),
    "points and lines": (mixed().glb(), ""),
    "draco": (draco_asset(draco_stream()).glb(), ""),
    "draco with a skin": (draco_skin().glb(), ""),
    "meshopt": (meshopt_asset().glb(), ""),
    "data uris": (text_gltf(), "a.gltf"),
    "a gltf with its files": (packed(scene()), "scene.zip"),
    "obj": (OBJ, "a.obj"),
    "ply": (PLY, "a.ply"),
    "stl": (stl(), "a.stl"),
}


@each_case("form", FORMS)
@each_case("name", list(ASSETS))
def test_everything_is_drawn_as_before(name: str, form: PartsAs) -> None:
    data, filename = ASSETS[name]
    asset = load_asset(data, filename)
    written = with_parts(asset, halves(asset), form)
    assert written == with_parts(asset, halves(asset), form)
    assert drawn(written) == drawn(data, filename)


@each_case("form", FORMS)
@each_case("name", list(ASSETS))
def test_everything_else_stays(name: str, form: PartsAs) -> None:
    data, filename = ASSETS[name]
    asset = load_asset(data, filename)
    written = with_parts(asset, halves(asset), form)
    before, after = asset._document, load_asset(written)._document
    apart = {"nodes", "meshes", "materials", "accessors", "bufferViews", "buffers", "animations", "images", "asset"}
    for key in before.root.keys() - apart:
        assert after.root[key] == before.root[key]
    about = {**after.root["asset"], "extras": after.root["asset"].get("extras", {})}
    about["extras"].pop("parts", None)
    assert about == {"extras": {}, **before.root["asset"]}
    for key in ("nodes", "materials", "animations"):
        assert [each.get("name") for each in after.root.get(key, [])][: len(before.root.get(key, []))] == [
            each.get("name") for each in before.root.get(key, [])
        ]
    for animation, other in zip(before.root.get("animations", []), after.root.get("animations", []), strict=True):
        assert animation["samplers"] == other["samplers"]
    kept = [skin["inverseBindMatrices"] for skin in before.root.get("skins", []) if "inverseBindMatrices" in skin]
    kept += [s[key] for a in before.root.get("animations", []) for s in a["samplers"] for key in ("input", "output")]
    for accessor in kept:
        np.testing.assert_array_equal(read_accessor(after, accessor), read_accessor(before, accessor))
    assert unpack(written)[2] == (unpack(data)[2] if data.startswith(b"glTF") else b"")


@each_case("name", list(ASSETS))
def test_parts_are_read_from_the_attribute(name: str) -> None:
    data, filename = ASSETS[name]
    asset = load_asset(data, filename)
    given = {part: flags for part, flags in halves(asset).items() if flags.any()}
    assert given
    again = load_asset(with_parts(asset, given))
    np.testing.assert_array_equal(
        again.surface.positions[again.surface.triangles], asset.surface.positions[asset.surface.triangles]
    )
    assert sorted(parts_of(again)) == sorted(given)
    for part, flags in parts_of(again).items():
        np.testing.assert_array_equal(flags, given[part])
    assert parts_of(asset) == {}


def test_a_triangle_has_one_part_at_all_of_its_corners() -> None:
    asset = load_asset(character().glb())
    again = load_asset(with_parts(asset, halves(asset)))
    root = again._document.root
    split = 0
    for node in (2, 3, 4):
        for primitive in root["meshes"][root["nodes"][node]["mesh"]]["primitives"][:2]:
            values = read_accessor(again._document, primitive["attributes"]["_PART"])[:, 0]
            faces = read_triangles(again._document, primitive, len(values), "")
            assert (values[faces] == values[faces[:, :1]]).all()
            item = root["accessors"][primitive["attributes"]["_PART"]]
            assert (item["componentType"], item["type"]) == (5121, "SCALAR")
            split += len(values)
    assert split > 6 * 2 * (_LENGTH + 1)
    assert root["asset"]["extras"]["parts"] == ["head", "left leg"]
    assert root["meshes"][0]["extras"] == {
        "targetNames": ["bulge", "smile"],
        "kept": [1],
        "parts": ["head", "left leg"],
    }


def test_what_needs_no_split_keeps_its_accessors() -> None:
    asset = load_asset(quad())
    before = unpack(asset.to_bytes())[0]
    after = unpack(with_parts(asset, {"all": np.ones(2, bool)}))[0]
    primitive = after["meshes"][0]["primitives"][0]
    primitive["attributes"].pop("_PART")
    assert primitive == before["meshes"][0]["primitives"][0]
    assert after["accessors"][: len(before["accessors"])] == before["accessors"]


def test_nodes_that_show_the_same_parts_share_their_mesh_and_others_do_not() -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive(QUAD_VERTS, QUAD_FACES))
    for x in range(4):
        builder.node(mesh, translation=[2 * x, 0, 0])
    asset = load_asset(builder.glb())
    head = np.array([1, 0, 1, 0, 0, 1, 0, 0], bool)
    root = unpack(with_parts(asset, {"head": head}))[0]
    # The last shows no part, and keeps the mesh.
    assert [node["mesh"] for node in root["nodes"]] == [1, 1, 2, 0]
    assert "_PART" not in root["meshes"][0]["primitives"][0]["attributes"]
    root = unpack(with_parts(asset, {"head": head}, PartsAs.NODES))[0]
    assert [node.get("mesh") for node in root["nodes"]] == [1, 1, 2, 0, 3, 3, 4]


def test_materials_have_the_names_of_parts() -> None:
    asset = load_asset(character().glb())
    root = unpack(with_parts(asset, halves(asset), PartsAs.MATERIALS))[0]
    assert root["materials"][0]["name"] == "Skin"
    assert sorted(each["name"] for each in root["materials"][1:]) == [
        "head",
        "head (Skin)",
        "left leg",
        "left leg (Skin)",
    ]
    assert all(
        {**each, "name": "Skin"} == root["materials"][0] for each in root["materials"] if "(Skin)" in each["name"]
    )


def test_nodes_have_the_names_of_parts_and_hang_on_theirs() -> None:
    asset = load_asset(character().glb())
    root = unpack(with_parts(asset, halves(asset), PartsAs.NODES))[0]
    person = root["nodes"][2]
    # What has no part, and the points, stay.
    assert {"mesh", "skin", "weights"} <= person.keys()
    children = [root["nodes"][child] for child in person["children"]]
    assert [child["name"] for child in children] == ["head", "left leg"]
    assert all((child["skin"], child["weights"]) == (0, [0.25, 0.5]) for child in children)
    assert root["meshes"][children[0]["mesh"]]["name"] == "head (Body)"
    assert root["meshes"][children[0]["mesh"]]["extras"]["targetNames"] == ["bulge", "smile"]
    assert root["nodes"][4]["camera"] == 0


def test_a_node_whose_mesh_is_parts_alone_has_none() -> None:
    builder = arm(targets=True)
    times = builder.accessor(np.array([0, 1], np.float32), bounds=True)
    builder.root["meshes"][0]["weights"] = [0.5]
    builder.root["animations"].append(
        {
            "samplers": [{"input": times, "output": builder.accessor(np.array([0, 1], np.float32))}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
        }
    )
    glb = builder.glb()
    asset = load_asset(glb)
    whole = np.ones(len(asset.surface.triangles), bool)
    upper = asset.surface.positions[asset.surface.triangles].mean(1)[:, 1] > 0
    written = with_parts(asset, {"upper": upper, "lower": whole}, PartsAs.NODES)
    root = unpack(written)[0]
    assert {"mesh", "skin"} & root["nodes"][0].keys() == set()
    assert len(root["animations"][-1]["channels"]) == len(root["nodes"][0]["children"])
    assert drawn(written) == drawn(glb)
    assert len({node["mesh"] for node in root["nodes"] if "mesh" in node}) == len(root["meshes"])


@each_case("form", FORMS)
def test_instances_of_a_gpu_stay(form: PartsAs) -> None:
    builder = Builder()
    mesh = builder.mesh(builder.primitive(QUAD_VERTS, QUAD_FACES))
    places = builder.accessor(np.array([[0, 0, 0], [3, 0, 0]], np.float32))
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    builder.node(mesh, extensions=instancing)
    builder.root["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    glb = builder.glb()
    parts = {"one": np.array([True, False]), "other": np.array([False, True])}
    written = with_parts(load_asset(glb), parts, form)
    assert drawn(written) == drawn(glb)
    owners = [node for node in unpack(written)[0]["nodes"] if "extensions" in node]
    assert all("mesh" in node for node in owners)


def test_polygons_that_a_part_cuts_are_triangles() -> None:
    verts, _ = _ladder()
    a = np.arange(_LENGTH)
    b = a + _LENGTH + 1
    quads = np.stack([a, a + 1, b + 1, a, b + 1, b], 1).reshape(-1, 3)
    asset = load_asset(build_glb([Primitive(verts, quads, polygons=((4, _LENGTH - 1), (3, 2)))]))
    head = np.zeros(2 * _LENGTH, bool)
    head[[0, 1, 2, 4, 5]] = head[-1] = True
    root = unpack(with_parts(asset, {"head": head}, PartsAs.MATERIALS))[0]
    assert [primitive["extras"]["polygons"] for primitive in root["meshes"][0]["primitives"]] == [
        [[3, 1], [4, _LENGTH - 4], [3, 1]],
        [[4, 1], [3, 1], [4, 1], [3, 1]],
    ]
    root = unpack(with_parts(asset, {"head": head}))[0]
    assert root["meshes"][0]["primitives"][0]["extras"]["polygons"] == [[4, _LENGTH - 1], [3, 2]]


def test_subdivision_and_a_new_shape_keep_the_parts() -> None:
    asset = load_asset(character().glb())
    again = load_asset(with_parts(asset, halves(asset)))
    moved = load_asset(again.replace(again.surface.positions + [1.0, 2.0, 3.0]))
    finer, done = again.subdivided(5000)
    assert done.split
    for other in (moved, finer):
        assert list(parts_of(other)) == list(parts_of(again))
    areas = {}
    for name, each in (("source", again), ("finer", finer)):
        a, b, c = each.surface.positions[each.surface.triangles].transpose(1, 0, 2)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        areas[name] = [area[flags].sum() for flags in parts_of(each).values()]
    np.testing.assert_allclose(areas["finer"], areas["source"], rtol=1e-4)


def test_a_part_of_two_corners_counts_where_a_tool_has_joined_vertices() -> None:
    builder = Builder()
    primitive = builder.primitive(QUAD_VERTS, QUAD_FACES, _PART=np.array([2, 1, 2, 1], np.float32))
    builder.node(builder.mesh(primitive, extras={"parts": ["head", "neck"]}))
    parts = parts_of(load_asset(builder.glb()))
    np.testing.assert_array_equal(parts["neck"], [True, False])
    np.testing.assert_array_equal(parts["head"], [False, True])


@each_case("wrong", [{}, {"parts": "head"}, {"parts": [1, 2]}, ["head"]])
def test_an_attribute_without_names_is_no_part(wrong: Any) -> None:
    builder = Builder()
    primitive = builder.primitive(QUAD_VERTS, QUAD_FACES, _PART=np.array([2, 1, 2, 1], np.float32))
    builder.node(builder.mesh(primitive, extras=wrong))
    assert parts_of(load_asset(builder.glb())) == {}


def test_wrong_parts_are_refused() -> None:
    asset = load_asset(quad())
    with pytest.raises(ShapeError, match=r"'head' must have shape \(2,\)"):
        with_parts(asset, {"head": np.ones(3, bool)})
    with pytest.raises(ShapeError, match="0 to 1"):
        with_parts(asset, PartLabels(("head",), np.array([0, 2])))
    with pytest.raises(AssetError, match="256 parts are too many"):
        with_parts(asset, {str(number): np.ones(2, bool) for number in range(256)})
    builder = rich()
    builder.root["asset"]["extras"] = [1]
    with pytest.raises(AssetError, match="no place"):
        with_parts(load_asset(builder.glb()), {"all": np.ones(2, bool)})


def test_the_first_of_parts_that_overlap_has_a_triangle() -> None:
    asset = load_asset(quad())
    parts = parts_of(load_asset(with_parts(asset, {"a": np.array([True, False]), "b": np.ones(2, bool)})))
    assert {name: flags.tolist() for name, flags in parts.items()} == {"a": [True, False], "b": [False, True]}
