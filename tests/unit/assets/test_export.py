"""OBJ, USDZ, 3MF and STL, opened by readers that are not ours: trimesh, Pixar's library and lib3mf."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.assets.export import Export, export
from meshdeform.errors import DependencyError, ParameterError
from meshdeform.geometry.shapes import icosphere
from tests.cases import each_case
from tests.toolchain.assets import ASSETS
from tests.unit.assets.builders import Builder
from tests.unit.assets.test_rig import arm

Floats = NDArray[np.float64]
UPRIGHT = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)
"""From +Y up to +Z up."""


def corners_of(asset: Asset) -> Floats:
    return np.asarray(asset.surface.positions[asset.surface.triangles])


def same_triangles(found: Floats, wanted: Floats, atol: float = 1e-5) -> None:
    """Compare triangles (T, 3, 3) without their order; each begins with any of its corners."""
    assert found.shape == wanted.shape
    keys = []
    for corners in (found, wanted):
        turned = np.stack([np.roll(corners, -k, axis=1) for k in range(3)], axis=1).reshape(len(corners), 3, 9)
        least = np.lexsort(np.round(turned, 4).transpose(2, 0, 1)[::-1], axis=1)[:, 0]
        first = turned[np.arange(len(corners)), least]
        keys.append(first[np.lexsort(np.round(first, 4).T[::-1])])
    np.testing.assert_allclose(keys[0], keys[1], atol=atol)


def read_obj(made: Export) -> Any:
    import trimesh

    with zipfile.ZipFile(io.BytesIO(made.data)) as package:
        files = {name: package.read(name) for name in package.namelist()}
    (name,) = [name for name in files if name.endswith(".obj")]
    resolver = {key: io.BytesIO(data).getvalue() for key, data in files.items()}
    return trimesh.load_scene(io.BytesIO(files[name]), "obj", resolver=resolver, process=False), files


def read_3mf(made: Export) -> tuple[Any, Any]:
    lib3mf = pytest.importorskip("lib3mf")
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(made.data)
    assert reader.GetWarningCount() == 0
    return model, wrapper


def meshes_of(model: Any) -> list[Any]:
    found, objects = [], model.GetMeshObjects()
    while objects.MoveNext():
        found.append(objects.GetCurrentMeshObject())
    return found


def triangles_of(meshes: list[Any]) -> Floats:
    found = []
    for mesh in meshes:
        verts = np.array([list(each.Coordinates) for each in mesh.GetVertices()])
        found.append(verts[np.array([list(each.Indices) for each in mesh.GetTriangleIndices()])])
    return np.concatenate(found)


def stage_of(made: Export, folder: Path) -> Any:
    pytest.importorskip("pxr")
    from pxr import Usd

    path = folder / f"made{len(list(folder.iterdir()))}.usdz"  # opened layers stay in memory by their names
    path.write_bytes(made.data)
    return Usd.Stage.Open(str(path))


def usd_triangles(stage: Any, seconds: float | None = None) -> Floats:
    """World triangles of a stage by Pixar's own skinning, at a time or at rest."""
    from pxr import Usd, UsdGeom, UsdSkel

    time = Usd.TimeCode.Default() if seconds is None else Usd.TimeCode(seconds * stage.GetTimeCodesPerSecond())
    cache, places, found = UsdSkel.Cache(), UsdGeom.XformCache(time), []
    root = UsdSkel.Root(stage.GetDefaultPrim())
    if root:
        cache.Populate(root, Usd.PrimDefaultPredicate)
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        points = UsdGeom.Mesh(prim).GetPointsAttr().Get(time)
        place = prim
        if prim.HasAPI(UsdSkel.BindingAPI):
            query = cache.GetSkinningQuery(prim)
            place = UsdSkel.BindingAPI(prim).GetInheritedSkeleton().GetPrim()
            skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(place))
            if query.HasBlendShapes() and skeleton.GetAnimQuery():
                weights = skeleton.GetAnimQuery().ComputeBlendShapeWeights(time)
                shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
                own = query.GetBlendShapeMapper().Remap(weights)
                sub, numbers, subshapes = shapes.ComputeSubShapeWeights(own)
                shapes.ComputeDeformedPoints(
                    sub,
                    numbers,
                    subshapes,
                    shapes.ComputeBlendShapePointIndices(),
                    shapes.ComputeSubShapePointOffsets(),
                    points,
                )
            assert query.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(time), points, time)
        matrix = np.array(places.GetLocalToWorldTransform(place))
        world = np.array(points, float) @ matrix[:3, :3] + matrix[3, :3]
        corners = np.array(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        found.append(world[corners[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else corners])
    return np.concatenate(found)


@each_case("make", [*ASSETS.values(), lambda: arm(targets=True).glb()])
def test_the_triangles_are_those_that_are_shown(make: Callable[[], bytes], tmp_path_factory: Any) -> None:
    import trimesh

    asset = load_asset(make())
    wanted = corners_of(asset)
    scene, _ = read_obj(export(asset, "a.obj.zip"))
    same_triangles(np.concatenate([mesh.triangles for mesh in scene.dump()]), wanted)
    stl = trimesh.load_mesh(io.BytesIO(export(asset, "a.stl").data), "stl", process=False)
    np.testing.assert_array_equal(stl.triangles, wanted.astype(np.float32))
    same_triangles(usd_triangles(stage_of(export(asset, "a.usdz"), tmp_path_factory.mktemp("usd"))), wanted)
    model, _ = read_3mf(export(asset, "a.3mf"))
    same_triangles(triangles_of(meshes_of(model)), 1000 * wanted @ UPRIGHT.T, atol=0.01)


@each_case("name", ["a.stl", "a.obj", "a.obj.zip", "a.usdz", "a.3mf"])
def test_the_same_asset_gives_the_same_bytes(name: str) -> None:
    if name == "a.usdz":
        pytest.importorskip("pxr")
    glb = ASSETS["scene"]()
    assert export(load_asset(glb), name).files == export(load_asset(glb), name).files


@each_case(("make", "times"), [(lambda: arm(targets=True).glb(), (0.0, 0.25, 0.7, 1.0)), (ASSETS["morphing"], (0.3,))])
def test_a_usdz_moves_as_the_poses_of_its_source(
    make: Callable[[], bytes], times: tuple[float, ...], tmp_path_factory: Any
) -> None:
    from meshdeform.assets.pose import Pose

    asset = load_asset(make())
    stage = stage_of(export(asset, "a.usdz"), tmp_path_factory.mktemp("usd"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 60)
    for seconds in times:
        posed = load_asset(export(asset, "a.glb", pose=Pose("0", seconds)).data)
        same_triangles(usd_triangles(stage, seconds), corners_of(posed), atol=5e-4)


def test_a_usdz_is_in_metres_with_y_up_and_passes_the_checks_of_its_library(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from pxr import UsdGeom, UsdSkel, UsdValidation

    for name, make in {**ASSETS, "arm": lambda: arm(targets=True).glb()}.items():
        made = export(load_asset(make()), "a.usdz")
        stage = stage_of(made, tmp_path)
        assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1.0)
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
        assert not [error.GetErrorAsString() for error in errors], name
        for prim in stage.Traverse():
            # Blender's bones have no scale: that of the armature is left to its node.
            for rest in UsdSkel.Skeleton(prim).GetRestTransformsAttr().Get() or []:
                np.testing.assert_allclose(np.linalg.det(np.array(rest)), 1, atol=1e-6)
        rigged = name in ("rigged", "arm", "morphing")
        assert stage.GetDefaultPrim().IsA(UsdSkel.Root) == rigged
        with zipfile.ZipFile(io.BytesIO(made.data)) as package:
            for entry in package.infolist():
                assert entry.compress_type == zipfile.ZIP_STORED
                head = made.data[entry.header_offset : entry.header_offset + 30]
                start = entry.header_offset + 30 + sum(int.from_bytes(head[k : k + 2], "little") for k in (26, 28))
                assert start % 64 == 0


def look(**more: Any) -> bytes:
    """A quad with a material of all that other formats can hold."""
    from PIL import Image

    builder = Builder()
    uvs = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)
    primitive = builder.primitive(TEXCOORD_0=uvs, **more)
    builder.root["images"] = []
    for number in range(4):
        with io.BytesIO() as file:
            Image.new("RGB", (2, 2), (50 * number, 0, 0)).save(file, "PNG")
            builder.root["images"].append({"bufferView": builder.view(file.getvalue()), "mimeType": "image/png"})
    builder.root["samplers"] = [{"wrapS": 33071, "wrapT": 33071}]
    builder.root["textures"] = [{"source": number, "sampler": 0} for number in range(4)]
    shading = {
        "baseColorFactor": [0.5, 0.25, 1.0, 0.5],
        "metallicFactor": 0.25,
        "roughnessFactor": 0.75,
        "baseColorTexture": {"index": 0},
        "metallicRoughnessTexture": {"index": 1},
    }
    extensions = {
        "KHR_materials_emissive_strength": {"emissiveStrength": 3.0},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.125},
        "KHR_materials_ior": {"ior": 1.25},
        "KHR_materials_sheen": {},
    }
    builder.root["materials"] = [
        {
            "name": "red paint",
            "pbrMetallicRoughness": shading,
            "normalTexture": {"index": 2, "scale": 0.5},
            "emissiveTexture": {"index": 3},
            "emissiveFactor": [0.5, 0.25, 0.125],
            "alphaMode": "BLEND",
            "doubleSided": True,
            "extensions": extensions,
        }
    ]
    builder.root["extensionsUsed"] = list(extensions)
    primitive["material"] = 0
    builder.node(builder.mesh(primitive), name="a quad")
    return builder.glb()


def test_a_usdz_has_the_whole_material(tmp_path: Path) -> None:
    made = export(load_asset(look()), "a.usdz")
    stage = stage_of(made, tmp_path)
    from pxr import UsdShade

    surface = UsdShade.Shader(stage.GetPrimAtPath("/Root/Materials/red_paint/Surface"))
    plain = {name: surface.GetInput(name).Get() for name in ("ior", "clearcoat", "clearcoatRoughness")}
    assert plain == {"ior": 1.25, "clearcoat": 0.5, "clearcoatRoughness": 0.125}
    textures = {}
    for slot in ("diffuseColor", "opacity", "metallic", "roughness", "emissiveColor", "normal"):
        source, output, _ = surface.GetInput(slot).GetConnectedSource()
        shader = UsdShade.Shader(source.GetPrim())
        textures[slot] = shader.GetInput("file").Get().path, output, tuple(shader.GetInput("scale").Get())
        assert shader.GetInput("wrapS").Get() == "clamp"
    assert textures == {
        "diffuseColor": ("textures/image0.png", "rgb", (0.5, 0.25, 1, 0.5)),
        "opacity": ("textures/image0.png", "a", (0.5, 0.25, 1, 0.5)),
        "metallic": ("textures/image1.png", "b", (1, 0.75, 0.25, 1)),
        "roughness": ("textures/image1.png", "g", (1, 0.75, 0.25, 1)),
        "emissiveColor": ("textures/image3.png", "rgb", (1.5, 0.75, 0.375, 1)),
        "normal": ("textures/image2.png", "rgb", (1, 1, 2, 1)),
    }
    mesh = stage.GetPrimAtPath("/Root/a_quad/a_quad")
    np.testing.assert_array_equal(mesh.GetAttribute("primvars:st").Get(), [[0, 1], [1, 1], [0, 0], [1, 0]])
    assert mesh.GetAttribute("doubleSided").Get() is True
    assert made.warnings == ("Left out: KHR_materials_sheen of materials.",)


def test_an_obj_has_materials_textures_and_coordinates() -> None:
    made = export(load_asset(look()), "a chair.obj.zip")
    scene, files = read_obj(made)
    assert set(files) == {"a chair.obj", "a_chair.mtl", *(f"a_chair_textures/image{k}.png" for k in range(4))}
    (mesh,) = scene.dump()
    np.testing.assert_allclose(mesh.visual.uv, [[0, 1], [1, 1], [0, 0], [1, 0]])
    lines = files["a_chair.mtl"].decode().splitlines()
    kinds = {line.split()[0]: line.split()[1:] for line in lines if line and not line.startswith("#")}
    encoded = [round(1.055 * value ** (1 / 2.4) - 0.055, 6) for value in (0.5, 0.25)]
    assert [round(float(value), 6) for value in kinds["Kd"]] == [*encoded, 1.0]
    assert [float(kinds[name][0]) for name in ("d", "Ni", "Pr", "Pm", "Pc", "Pcr")] == [
        0.5,
        1.25,
        0.75,
        0.25,
        0.5,
        0.125,
    ]
    assert kinds["norm"] == ["-clamp", "on", "-bm", "0.5", "a_chair_textures/image2.png"]
    assert "map_Pm -imfchan b -clamp on a_chair_textures/image1.png" in lines
    assert {"map_Kd", "map_Ke", "map_Pr", "map_d"} <= kinds.keys()
    again = load_asset(made.data, "a.zip")
    np.testing.assert_array_equal(corners_of(again), corners_of(load_asset(look())))


def test_a_3mf_has_colours_and_textures() -> None:
    model, _ = read_3mf(export(load_asset(look()), "a.3mf"))
    assert model.GetUnit().name == "MilliMeter"
    (mesh,) = meshes_of(model)
    assert mesh.GetName() == "a quad"
    places = []
    for properties in mesh.GetAllTriangleProperties():
        group = model.GetTexture2DGroupByID(properties.ResourceID)
        places.append([(place.U, place.V) for place in map(group.GetTex2Coord, properties.PropertyIDs)])
        texture = group.GetTexture2D()
        assert bytes(texture.GetAttachment().WriteToBuffer()).startswith(b"\x89PNG")
    corners = {tuple(place) for triangle in places for place in triangle}
    assert corners == {(0, 1), (1, 1), (0, 0), (1, 0)}

    colors = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], np.float32)
    asset = load_asset(build_glb(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
        colors=colors, material="m", base_color=(1, 1, 0.21404114, 1),
    ))  # fmt: skip
    model, _ = read_3mf(export(asset, "a.3mf"))
    (mesh,) = meshes_of(model)
    assert mesh.IsManifoldAndOriented()
    verts = np.array([list(each.Coordinates) for each in mesh.GetVertices()])
    shades = {}
    for corner, properties in zip(mesh.GetTriangleIndices(), mesh.GetAllTriangleProperties(), strict=True):
        group = model.GetColorGroupByID(properties.ResourceID)
        for at, number in zip(corner.Indices, properties.PropertyIDs, strict=True):
            color = group.GetColor(number)
            shades[tuple(verts[at].tolist())] = color.Red, color.Green, color.Blue, color.Alpha
    # In millimetres with Z up: +Y becomes +Z, and +Z becomes -Y. Linear 0.214 is 127.5 of 255.
    blue = shades[0.0, 0.0, 1000.0][2]
    assert blue in (127, 128)
    assert shades == {
        (0.0, 0.0, 0.0): (255, 0, 0, 255),
        (1000.0, 0.0, 0.0): (0, 255, 0, 255),
        (0.0, 0.0, 1000.0): (0, 0, blue, 255),
        (0.0, -1000.0, 0.0): (255, 255, blue, 255),
    }


def test_places_that_instancing_draws_are_all_written(tmp_path: Path) -> None:
    builder = Builder()
    moves = builder.accessor(np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0]], np.float32))
    instanced = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": moves}}}
    builder.node(builder.mesh(builder.primitive()), extensions=instanced)
    builder.root["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    asset = load_asset(builder.glb())
    quad = corners_of(asset)
    wanted = np.concatenate([quad, quad + [5, 0, 0], quad + [0, 5, 0]])
    same_triangles(np.concatenate([mesh.triangles for mesh in read_obj(export(asset, "a.obj.zip"))[0].dump()]), wanted)
    same_triangles(usd_triangles(stage_of(export(asset, "a.usdz"), tmp_path)), wanted)
    assert export(asset, "a.stl").facts["triangles"] == 6


def test_what_is_lost_is_told() -> None:
    pytest.importorskip("pxr")
    said = {name: set(export(load_asset(ASSETS["extended"]()), name).warnings) for name in ("a.usdz", "a.obj", "a.stl")}
    everywhere = {"Left out: cameras.", "Left out: lights.", "Left out: variants of materials."}
    assert all(everywhere <= found for found in said.values())
    assert "Left out: materials." in said["a.stl"]
    rigged = export(load_asset(ASSETS["rigged"]()), "a.obj").warnings
    assert {"Without animations.", "Without skins."} <= set(rigged)
    mesh = icosphere(0)
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in mesh.verts) + "".join(
        f"f {a} {b} {c}\n" for a, b, c in mesh.faces + 1
    )
    asset = load_asset(text.encode(), "a.obj")
    made = export(asset, "a.3mf")
    assert "The source says no unit: its numbers are written as they are, as mm." in made.warnings
    model, _ = read_3mf(made)
    assert np.abs(triangles_of(meshes_of(model))).max() == pytest.approx(np.abs(mesh.verts).max())


@each_case(
    ("name", "more", "said"),
    [
        ("a.fbx", {}, "permissive"),
        ("a.usda", {}, "packages"),
        ("a", {}, "ends in nothing"),
        ("a.usdz", {"up": "z"}, "one axis"),
        ("a.3mf", {"up": "y"}, "one axis"),
        ("a.glb", {"unit": "mm"}, "one unit"),
    ],
)
def test_what_is_not_written_is_refused(name: str, more: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        export(load_asset(ASSETS["scene"]()), name, **more)


def test_without_usd_core_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("meshdeform.assets.export.find_spec", lambda _name: None)
    with pytest.raises(DependencyError, match="usd-core") as caught:
        export(load_asset(ASSETS["scene"]()), "a.usdz")
    assert "[usd]" in str(caught.value.advice_text)
