"""OBJ and STL hold the triangles of the asset's world, read back by trimesh and by the service's own reader."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.assets.obj_file import Obj, write_obj
from meshdeform.assets.scene import SceneView
from meshdeform.assets.stl_file import Stl, write_stl
from meshdeform.assets.world import Edges, Frame, count_edges, place_meshes
from meshdeform.errors import AssetEmptyError, AssetError, AssetNotFiniteError
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.unit.assets.builders import QUAD_FACES, QUAD_NORMALS, QUAD_VERTS, Builder

UVS = np.array([[0, 0], [1, 0], [0, 1], [0.75, 0.1]], np.float32)
COLORS = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0.25, 1, 0.5], [1, 1, 1, 1]], np.float32)
TURN = [0.0, float(np.sqrt(0.5)), 0.0, float(np.sqrt(0.5))]


def quad(builder: Builder, look: int | None = None, **attributes: Any) -> dict[str, Any]:
    made = builder.primitive(QUAD_VERTS, QUAD_FACES, NORMAL=QUAD_NORMALS, TEXCOORD_0=UVS, **attributes)
    return made if look is None else {**made, "material": look}


def picture(kind: str, seed: int) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 255, (4, 4, 3), np.uint8)
    with io.BytesIO() as file:
        Image.fromarray(pixels).save(file, kind)
        return file.getvalue()


def textured(builder: Builder, image: bytes, **sampler: Any) -> int:
    root = builder.root
    root.setdefault("images", []).append({"bufferView": builder.view(image)})
    root.setdefault("samplers", []).append(sampler)
    root.setdefault("textures", []).append({"source": len(root["images"]) - 1, "sampler": len(root["samplers"]) - 1})
    return len(root["textures"]) - 1


def nested() -> Builder:
    builder = Builder()
    inner = builder.node(builder.mesh(quad(builder)), in_scene=False, translation=[1, 2, 3], scale=[2, 3, 4])
    builder.node(children=[inner], rotation=TURN, translation=[10, 0, 0])
    return builder


def mirrored() -> Builder:
    builder = Builder()
    mesh = builder.mesh(quad(builder))
    inner = builder.node(mesh, in_scene=False, scale=[1, -2, 1], rotation=TURN)
    builder.node(children=[inner], scale=[-1, 1, 1])
    builder.node(mesh, scale=[1, 1, -3], translation=[5, 0, 0])
    return builder


def instanced() -> Builder:
    builder = Builder()
    mesh = builder.mesh(quad(builder))
    for x in range(3):
        builder.node(mesh, translation=[x, 0, 0], name="same name")
    return builder


def skinned() -> Builder:
    """The skin stands elsewhere than its node."""
    builder = Builder()
    weights: dict[str, Any] = {
        "JOINTS_0": np.zeros((4, 4), np.uint8),
        "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 4],
    }
    mesh = builder.mesh(quad(builder, **weights))
    joint = builder.node(translation=[0, 7, 0])
    builder.root["skins"] = [{"joints": [joint]}]
    builder.node(mesh, skin=0, translation=[100, 0, 0])
    return builder


def strip() -> Builder:
    builder = Builder()
    primitive = {**quad(builder), "mode": 5, "indices": builder.accessor(np.array([0, 1, 2, 3], np.uint16))}
    builder.node(builder.mesh(primitive))
    return builder


def written(glb: bytes, **options: Any) -> tuple[Obj, Stl]:
    asset = load_asset(glb)
    return write_obj(asset.scene(), **options), write_stl(asset.scene(), **options)


def read_stl(stl: Stl) -> Any:
    import trimesh

    return trimesh.load_mesh(io.BytesIO(stl.data), file_type="stl", process=False)


def obj_corners(obj: Obj) -> NDArray[np.float32]:
    """Corners of all triangles, (T, 3, 3), by a reader of nothing but `v` and `f`."""
    lines = [line.split() for line in next(iter(obj.files.values())).decode().splitlines()]
    places = np.array([line[1:4] for line in lines if line[:1] == ["v"]], np.float32)
    faces = np.array([[corner.split("/")[0] for corner in line[1:]] for line in lines if line[:1] == ["f"]], np.int64)
    return places[faces - 1]


@each_case("build", [nested, mirrored, instanced, skinned, strip])
def test_the_triangles_are_those_of_the_world_to_the_last_bit(build: Any) -> None:
    glb = build().glb()
    surface = load_asset(glb).surface
    obj, stl = written(glb)
    wanted = surface.positions[surface.triangles].astype(np.float32)
    # A mirrored triangle begins at another corner; its winding is the same.
    for found in (obj_corners(obj), read_stl(stl).triangles.astype(np.float32)):
        assert found.shape == wanted.shape
        turns = [(np.roll(found, turn, axis=1) == wanted).all(axis=(1, 2)) for turn in range(3)]
        assert np.any(turns, axis=0).all()
    assert (obj.triangles, stl.triangles) == (len(wanted),) * 2


def test_area_volume_and_normals_are_kept_under_a_mirror_and_an_uneven_scale() -> None:
    import trimesh

    ball = icosphere(2)
    verts = ball.verts.numpy()
    builder = Builder()
    faces = ball.faces.numpy().astype(np.uint16)
    mesh = builder.mesh(builder.primitive(verts, faces, NORMAL=verts.astype(np.float32)))
    builder.node(mesh, scale=[-1, 2, 3], rotation=TURN, name="egg")
    obj, stl = written(builder.glb())
    found, plain = read_stl(stl), trimesh.Trimesh(verts, ball.faces.numpy(), process=False)
    assert found.volume == pytest.approx(6 * plain.volume, rel=1e-5)
    assert (stl.edges, stl.edges.closed, stl.edges.words) == (Edges(0, 0), True, "the surface is closed")
    assert b"320 triangles in metres, +Y up; the surface is closed" in obj.files["result.obj"]
    assert b"o egg" in obj.files["result.obj"].splitlines()
    again = trimesh.load_mesh(io.BytesIO(obj.files["result.obj"]), file_type="obj", process=False)
    assert again.area == pytest.approx(found.area, rel=1e-6)
    lines = [line.split() for line in obj.files["result.obj"].decode().splitlines()]
    places, normals = (np.array([line[1:] for line in lines if line[0] == key], np.float64) for key in ("v", "vn"))
    gradients = places / np.array([3, 2, 1]) ** 2  # an ellipsoid's normals
    np.testing.assert_allclose(normals, gradients / np.linalg.norm(gradients, axis=1, keepdims=True), atol=1e-5)


def test_the_frame_of_a_file_is_chosen() -> None:
    plain = written(nested().glb())[1]
    obj, stl = written(nested().glb(), frame=Frame("z", "mm"))
    x, y, z = read_stl(plain).triangles.reshape(-1, 3).T
    turned = 1000 * np.stack([x, -z, y], axis=1)
    np.testing.assert_allclose(read_stl(stl).triangles.reshape(-1, 3), turned, rtol=1e-6, atol=1e-3)
    assert b"millimetres, +Z up; open edges 4, tangled 0" in stl.data[:80]
    assert b"millimetres, +Z up; the surface is not closed: 4 open edges, 0 tangled edges" in obj.files["result.obj"]
    assert not stl.data.startswith(b"solid")


def test_copies_by_an_extension_are_written_where_they_are_drawn() -> None:
    builder = Builder()
    places = np.array([[0, 0, 0], [5, 0, 0], [0, 9, 0]], np.float32)
    many = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": builder.accessor(places)}}}
    builder.node(builder.mesh(quad(builder)), scale=[2, 2, 2], extensions=many, name="tree")
    builder.root["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    obj, stl = written(builder.glb())
    wanted = np.concatenate([2 * (QUAD_VERTS[QUAD_FACES] + place) for place in places])
    np.testing.assert_array_equal(read_stl(stl).triangles, wanted)
    assert [line for line in obj.files["result.obj"].splitlines() if line[:2] == b"o "] == [
        b"o tree",
        b"o tree_2",
        b"o tree_3",
    ]


def test_a_scene_whose_only_node_is_flat_has_nothing_to_write() -> None:
    builder = Builder()
    builder.node(builder.mesh(quad(builder)), scale=[2, 2, 0])
    flat = SceneView(Document.parse(builder.glb(), Limits(), glb=True))
    assert list(place_meshes(flat)) == []
    with pytest.raises(AssetEmptyError, match="no triangles"):
        write_stl(flat)
    with pytest.raises(AssetEmptyError, match="no triangles"):
        write_obj(flat)


@each_case(
    "broken",
    [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 7}}},
        {"pbrMetallicRoughness": {"baseColorTexture": {}}},
        {"pbrMetallicRoughness": {"baseColorFactor": [1, 1]}},
        {"pbrMetallicRoughness": {"roughnessFactor": "rough"}},
        {"emissiveTexture": 3},
        {"name": 3},
    ],
)
def test_a_broken_material_is_told(broken: dict[str, Any]) -> None:
    builder = Builder()
    builder.root["materials"] = [broken]
    builder.node(builder.mesh(quad(builder, look=0)))
    asset = load_asset(builder.glb())  # the deformation does not mind
    with pytest.raises(AssetError, match=r"materials\[0\]"):
        asset.scene()


def looks() -> Builder:
    """Three materials, one of them with every kind of texture, and one primitive without a material."""
    builder = Builder()
    red = textured(builder, picture("PNG", 0), wrapS=33071, wrapT=33071)
    bumps, rough = textured(builder, picture("JPEG", 1)), textured(builder, picture("PNG", 2))
    other = textured(builder, picture("PNG", 3))
    turned = {"extensions": {"KHR_texture_transform": {"scale": [2, 1], "offset": [0.5, 0]}}}
    builder.root["materials"] = [
        {
            "name": "rød lak",
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": red},
                "baseColorFactor": [1, 0.5, 0.25, 0.5],
                "metallicRoughnessTexture": {"index": rough},
                "roughnessFactor": 0.75,
            },
            "normalTexture": {"index": bumps},
            "occlusionTexture": {"index": rough},
            "emissiveTexture": {"index": other, "texCoord": 1},
            "alphaMode": "BLEND",
        },
        {"name": "rød lak", "pbrMetallicRoughness": {"baseColorTexture": {"index": red, **turned}}},
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 1, 1], "metallicFactor": 0}, "emissiveFactor": [1, 0, 0]},
    ]
    primitives = [quad(builder, 0, TEXCOORD_1=UVS), quad(builder, 1), quad(builder, 2), quad(builder)]
    builder.node(builder.mesh(*primitives), name="a table\n")
    return builder


def test_materials_and_textures_are_those_of_the_asset() -> None:
    glb = looks().glb()
    obj = write_obj(load_asset(glb).scene(), stem="my table")
    assert list(obj.files) == [
        "my table.obj",
        "my_table.mtl",
        "textures/image0.png",
        "textures/image2.png",
        "textures/image1.jpg",
    ]
    for number, ending, image in ((0, "png", ("PNG", 0)), (1, "jpg", ("JPEG", 1)), (2, "png", ("PNG", 2))):
        assert obj.files[f"textures/image{number}.{ending}"] == picture(*image)
        assert picture(*image) in glb
    library = obj.files["my_table.mtl"].decode()
    first, second, third, last = library.split("newmtl ")[1:]
    assert first.splitlines() == [
        "rød_lak",
        "illum 2",
        "Kd 1 0.5 0.25",
        "d 0.5",
        "Ke 0 0 0",
        "Ni 1.5",
        "Pr 0.75",
        "Pm 1",
        "map_Kd -clamp on textures/image0.png",
        "map_d -imfchan m -clamp on textures/image0.png",
        "map_Pr -imfchan g textures/image2.png",
        "map_Pm -imfchan b textures/image2.png",
        "norm textures/image1.jpg",
        "",
    ]
    assert second.startswith("rød_lak_2\n")
    assert {"Kd 0 0 1", "Pm 0", "Ke 1 0 0"} <= set(third.splitlines())
    assert last.startswith("default\n")
    assert obj.left_out == {
        "occlusion textures": 1,
        "textures with other coordinates than the base colour": 1,
        "further sets of texture coordinates": 1,
    }
    text = obj.files["my table.obj"].decode()
    assert "mtllib my_table.mtl" in text.splitlines()
    assert "# left out: 1 occlusion textures" in text.splitlines()
    assert [line for line in text.splitlines() if line.startswith("usemtl")] == [
        "usemtl rød_lak",
        "usemtl rød_lak_2",
        "usemtl material2",
        "usemtl default",
    ]
    uvs = np.array([line.split()[1:] for line in text.splitlines() if line.startswith("vt ")], np.float64)
    upwards = UVS.astype(np.float64) * [1, -1] + [0, 1]
    np.testing.assert_allclose(uvs[:4], upwards, atol=1e-11)
    np.testing.assert_allclose(uvs[4:8], upwards * [2, 1] + [0.5, 0], atol=1e-11)


def test_the_services_own_reader_takes_the_zip() -> None:
    builder = Builder()
    image = textured(builder, picture("PNG", 5))
    builder.root["materials"] = [
        {"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": image}, "metallicFactor": 0}}
    ]
    builder.node(builder.mesh(quad(builder, 0)), translation=[1, 2, 3])
    glb = builder.glb()
    first, second = (written(glb)[0].to_zip() for _ in range(2))
    assert first == second
    assert zipfile.ZipFile(io.BytesIO(first)).namelist() == ["result.obj", "result.mtl", "textures/image0.png"]
    asset, again = load_asset(glb), load_asset(first, "result.obj.zip")
    surface, read = asset.surface, again.surface
    np.testing.assert_array_equal(
        read.positions[read.triangles].astype(np.float32), surface.positions[surface.triangles].astype(np.float32)
    )
    wanted, found = (next(iter(each.scene().primitives(0))) for each in (asset, again))
    np.testing.assert_array_equal(found.texcoords[0][found.triangles], wanted.texcoords[0][wanted.triangles])
    assert found.normals is not None
    np.testing.assert_allclose(found.normals[found.triangles], QUAD_NORMALS[QUAD_FACES], atol=1e-6)
    (material,) = again.scene().materials
    assert (material.name, material.metallic, material.roughness) == ("paint", 0.0, 1.0)
    assert again.scene().image(material.textures["base_color"].image).data == picture("PNG", 5)


def test_vertex_colors_follow_the_position() -> None:
    import trimesh

    builder = Builder()
    builder.node(builder.mesh(builder.primitive(COLOR_0=COLORS)))
    obj, _ = written(builder.glb())
    assert list(obj.files) == ["result.obj"]  # no materials, so no library
    found = trimesh.load_mesh(io.BytesIO(obj.files["result.obj"]), file_type="obj", process=False)
    nearest = np.abs(found.vertices[:, None] - QUAD_VERTS[None]).sum(axis=2).argmin(axis=1)
    np.testing.assert_allclose(found.visual.vertex_colors[:, :3] / 255, COLORS[nearest, :3], atol=1 / 255)


def test_edges_are_counted_at_places_not_at_vertices() -> None:
    ball = icosphere(1)
    corners = ball.verts.numpy().astype(np.float32)[ball.faces.numpy()]
    assert count_edges([corners[:40], corners[40:]]) == Edges(0, 0)
    assert count_edges([corners[1:]]) == Edges(3, 0)
    assert count_edges([corners[1:], corners[:1, ::-1]]) == Edges(0, 3)  # one triangle faces inwards
    assert count_edges([corners, corners[:1]]) == Edges(0, 3)  # three triangles at each of its edges
    thin = corners[:1].copy()
    thin[:, 2] = thin[:, 1]
    assert count_edges([corners, thin]) == Edges(0, 0)
    zero = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-0.0, 0, 0], [0, 1, -0.0], [1, 0, 0]]], np.float32)
    assert count_edges([zero]) == Edges(0, 0)
    assert count_edges([]) == Edges(0, 0)


def test_flattened_nodes_are_passed_over_and_endless_ones_refused(tmp_path: Path) -> None:
    builder = Builder()
    mesh = builder.mesh(quad(builder))
    builder.node(mesh)
    builder.node(mesh, scale=[1, 1, 0], name="flat")
    assert [each.triangles for each in written(builder.glb())] == [2, 2]
    builder = Builder()
    many = {"TRANSLATION": builder.accessor(np.array([[0, 0, 0], [3e38, 0, 0]], np.float32))}
    builder.node(
        builder.mesh(quad(builder)), scale=[9, 9, 9], extensions={"EXT_mesh_gpu_instancing": {"attributes": many}}
    )
    with pytest.raises(AssetNotFiniteError, match=r"nodes\[0\]"):
        written(builder.glb())


def test_a_deformed_result_is_written_as_it_was_deformed() -> None:
    asset = load_asset(build_glb(icosphere(1).verts.numpy(), icosphere(1).faces.numpy()))
    moved = asset.surface.positions * [1.0, 2.0, 0.5] + np.sin(asset.surface.positions)
    stl = written(asset.replace(moved))[1]
    np.testing.assert_allclose(read_stl(stl).triangles, moved[asset.surface.triangles], atol=1e-6)
    assert stl.edges.closed
