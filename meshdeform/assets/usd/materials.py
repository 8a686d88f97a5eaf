"""Convert glTF's metallic-roughness materials to UsdPreviewSurface networks.

Both are the same model with the same parameters, so that factors, channels and samplers carry over unchanged, with two
differences: USD's texture coordinates grow upwards, and a preview surface cannot multiply textures by vertex colours.

Sources: UsdPreviewSurface specification 2.6 (Pixar); glTF 2.0, section 3.9; KHR_texture_transform.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf

from meshdeform.assets.materials import Shading, TextureUse
from meshdeform.assets.scene import Scene
from meshdeform.assets.usd.layer import TYPES, Layer

_ONE = (1.0, 1.0, 1.0, 1.0)
_ZERO = (0.0, 0.0, 0.0, 0.0)


def texcoord_name(number: int) -> str:
    """Return the name of the primvar for a set of texture coordinates."""
    return "st" if number == 0 else f"st{number}"


class Materials:
    """Creates each material when the first mesh needs it. `written`: the textures, relative to `folder`."""

    def __init__(self, layer: Layer, scene: Scene, folder: Path) -> None:
        self._layer, self._scene, self._folder = layer, scene, folder
        self._scope = layer.prim(layer.root, "Materials", "Scope")
        self._made: dict[tuple[int | None, bool], str] = {}
        self._paths: dict[int, str] = {}
        self.written: list[str] = []

    def bind(self, prim: str, material: int | None, *, colored: bool) -> None:
        """Bind a material to a mesh; `colored`: whether the mesh has colours that the material shows."""
        key = (material, colored)
        if key not in self._made:
            look = self._scene.shading(material)
            path = self._layer.prim(self._scope, look.name, "Material")
            output = self._layer.set(path, "outputs:surface", TYPES.Token)
            self._layer.connect(output, _Network(self._layer, path, look, self, colored=colored).surface)
            self._made[key] = path
        self._layer.link(prim, "material:binding", self._made[key])

    def texture(self, image: int) -> str:
        """Return an image's path relative to the layer, or "" if it cannot be read."""
        if image not in self._paths:
            data, kind = self._scene.image(image)
            self._paths[image] = path = f"textures/image{image}.{kind}" if data else ""
            if path:
                (self._folder / "textures").mkdir(exist_ok=True)
                (self._folder / path).write_bytes(data)
                self.written.append(path)
        return self._paths[image]


class _Network:
    """The shaders of one material. `surface` is the output to connect the material to."""

    def __init__(self, layer: Layer, path: str, look: Shading, materials: Materials, *, colored: bool) -> None:
        self._layer, self._path, self._look, self._materials, self._colored = layer, path, look, materials, colored
        self._shaders: dict[str, str] = {}
        self._outputs: dict[tuple[str, str], Any] = {}
        self._surface = self._shader("Surface", "UsdPreviewSurface")
        self.surface = self._output(self._surface, "surface", TYPES.Token)
        self._base()
        if look.base.unlit:  # emission only, no reflection
            self._set("useSpecularWorkflow", TYPES.Int, 1)
            self._set("specularColor", TYPES.Color3f, Gf.Vec3f(0.0))
            self._set("diffuseColor", TYPES.Color3f, Gf.Vec3f(0.0))
            self._set("roughness", TYPES.Float, 1.0)
            return
        self._metallic_roughness()
        self._emissive()
        self._bumps()
        for name, value, usual in (
            ("ior", look.ior, 1.5),
            ("clearcoat", look.clearcoat, 0.0),
            ("clearcoatRoughness", look.clearcoat_roughness, 0.0),
        ):
            if value != usual:
                self._set(name, TYPES.Float, value)

    def _base(self) -> None:
        base = self._look.base
        name = "emissiveColor" if base.unlit else "diffuseColor"
        texture = self._texture("base_color", "sRGB", scale=base.base_color)
        if texture:
            self._connect(name, TYPES.Color3f, texture, "rgb")
        elif self._colored:
            reader = self._reader("VertexColor", "UsdPrimvarReader_float3", "displayColor")
            self._connect(name, TYPES.Color3f, reader, "result")
        else:
            self._set(name, TYPES.Color3f, Gf.Vec3f(*base.base_color[:3]))
        # A mask with cutoff 0 hides nothing, but an opacityThreshold of 0 would mean blending.
        if base.alpha_mode == "BLEND" or (base.alpha_mode == "MASK" and base.alpha_cutoff > 0.0):
            if texture:
                self._connect("opacity", TYPES.Float, texture, "a")
            elif self._colored:
                reader = self._reader("VertexOpacity", "UsdPrimvarReader_float", "displayOpacity")
                self._connect("opacity", TYPES.Float, reader, "result")
            else:
                self._set("opacity", TYPES.Float, base.base_color[3])
            if base.alpha_mode == "MASK":
                self._set("opacityThreshold", TYPES.Float, base.alpha_cutoff)

    def _metallic_roughness(self) -> None:
        look = self._look
        texture = self._texture("metallic_roughness", "raw", scale=(1.0, look.roughness, look.metallic, 1.0))
        if texture:
            self._connect("metallic", TYPES.Float, texture, "b")
            self._connect("roughness", TYPES.Float, texture, "g")
        else:
            self._set("metallic", TYPES.Float, look.metallic)
            self._set("roughness", TYPES.Float, look.roughness)

    def _emissive(self) -> None:
        look = self._look
        if not any(look.emissive):
            return
        texture = self._texture("emissive", "sRGB", scale=(*look.emissive, 1.0))
        if texture:
            self._connect("emissiveColor", TYPES.Color3f, texture, "rgb")
        else:
            self._set("emissiveColor", TYPES.Color3f, Gf.Vec3f(*look.emissive))

    def _bumps(self) -> None:
        """Add the normal map, 0..1 to -1..1 with the strength on x and y, and occlusion, 1 + strength (texture - 1)."""
        by, share = self._look.normal_scale, self._look.occlusion_strength
        normal = self._texture("normal", "raw", scale=(2 * by, 2 * by, 2.0, 1.0), bias=(-by, -by, -1.0, 0.0))
        if normal:
            self._connect("normal", TYPES.Normal3f, normal, "rgb")
        occlusion = self._texture("occlusion", "raw", scale=(share,) * 3 + (1.0,), bias=(1.0 - share,) * 3 + (0.0,))
        if occlusion:
            self._connect("occlusion", TYPES.Float, occlusion, "r")

    def _texture(
        self, slot: str, space: str, *, scale: tuple[float, ...] = _ONE, bias: tuple[float, ...] = _ZERO
    ) -> str:
        """Add a texture, and return the path of its shader; "" if the material has none that can be read."""
        use = self._look.textures.get(slot)
        file = "" if use is None else self._materials.texture(use.image)
        if use is None or not file:
            return ""
        name = "".join(word.capitalize() for word in slot.split("_"))
        shader = self._shader(name, "UsdUVTexture")
        self._input(shader, "file", TYPES.Asset, Sdf.AssetPath(file))
        self._input(shader, "sourceColorSpace", TYPES.Token, space)
        for side, wrap in zip(("wrapS", "wrapT"), use.wrap, strict=True):
            self._input(shader, side, TYPES.Token, wrap)
        if scale != _ONE:
            self._input(shader, "scale", TYPES.Float4, Gf.Vec4f(*scale))
        if any(bias):
            self._input(shader, "bias", TYPES.Float4, Gf.Vec4f(*bias))
        self._layer.connect(self._input(shader, "st", TYPES.Float2), self._coordinates(name, use))
        return shader

    def _coordinates(self, name: str, use: TextureUse) -> Any:
        variable = texcoord_name(use.texcoord)
        reader = self._output(self._reader(variable, "UsdPrimvarReader_float2", variable), "result", TYPES.Float2)
        if (use.offset, use.rotation, use.scale) == ((0.0, 0.0), 0.0, (1.0, 1.0)):
            return reader
        # glTF rotates and scales about the upper left corner, USD about the lower left one, in the same direction.
        (x, y), (across, down) = use.offset, use.scale
        sine, cosine = math.sin(use.rotation), math.cos(use.rotation)
        shader = self._shader(f"{name}Transform", "UsdTransform2d")
        self._layer.connect(self._input(shader, "in", TYPES.Float2), reader)
        self._input(shader, "scale", TYPES.Float2, Gf.Vec2f(across, down))
        self._input(shader, "rotation", TYPES.Float, math.degrees(use.rotation))
        self._input(shader, "translation", TYPES.Float2, Gf.Vec2f(x + sine * down, 1.0 - y - cosine * down))
        return self._output(shader, "result", TYPES.Float2)

    def _reader(self, name: str, kind: str, variable: str) -> str:
        if name not in self._shaders:
            self._input(self._shader(name, kind), "varname", TYPES.String, variable)
        return self._shaders[name]

    def _shader(self, name: str, kind: str) -> str:
        shader = self._shaders[name] = self._layer.prim(self._path, name, "Shader")
        self._layer.set(shader, "info:id", TYPES.Token, kind, uniform=True)
        return shader

    def _output(self, shader: str, name: str, kind: Any) -> Any:
        if (shader, name) not in self._outputs:
            self._outputs[shader, name] = self._layer.set(shader, f"outputs:{name}", kind)
        return self._outputs[shader, name]

    def _input(self, shader: str, name: str, kind: Any, value: Any = None) -> Any:
        return self._layer.set(shader, f"inputs:{name}", kind, value)

    def _set(self, name: str, kind: Any, value: Any) -> None:
        self._input(self._surface, name, kind, value)

    def _connect(self, name: str, kind: Any, source: str, output: str) -> None:
        """Connect an input of the surface, with three channels for a colour or normal and one for anything else."""
        made = TYPES.Float if kind == TYPES.Float else TYPES.Float3
        self._layer.connect(self._input(self._surface, name, kind), self._output(source, output, made))
