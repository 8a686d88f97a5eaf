"""Convert glTF's metallic-roughness materials to UsdPreviewSurface networks.

Both are the same model with the same parameters, so that factors, channels and samplers carry over unchanged, with two
differences: USD's texture coordinates grow upwards, and a preview surface cannot multiply textures by vertex colours.

Sources: UsdPreviewSurface specification 2.6 (Pixar); glTF 2.0, section 3.9; KHR_texture_transform.
"""

from __future__ import annotations

import math
from typing import Any

from pxr import Gf, Sdf

from meshdeform.assets.materials import Material, TextureUse
from meshdeform.assets.scene import SceneView
from meshdeform.assets.usd.layer import Layer, attribute, connect
from meshdeform.assets.usd.names import Names
from meshdeform.assets.usd.textures import Textures

__all__ = ["Materials", "texcoord_name"]

_TYPES = Sdf.ValueTypeNames
_ONE = (1.0, 1.0, 1.0, 1.0)


def texcoord_name(number: int) -> str:
    """Return the name of the primvar for a set of texture coordinates."""
    return "st" if number == 0 else f"st{number}"


class Materials:
    """Creates each material when the first mesh needs it.

    Parameters
    ----------
    layer : Layer
    scope : str
        Path of the prim that holds the materials.
    scene : SceneView
    textures : Textures
    """

    def __init__(self, layer: Layer, scope: str, scene: SceneView, textures: Textures) -> None:
        self._layer, self._scope, self._scene, self._textures = layer, scope, scene, textures
        self._names = Names()
        self._made: dict[tuple[int | None, bool], Sdf.Path] = {}

    def of(self, number: int | None) -> Material:
        """Return a primitive's material, or glTF's default material for None."""
        return Material() if number is None else self._scene.materials[number]

    def bind(self, prim: Sdf.PrimSpec, number: int | None, *, colored: bool) -> None:
        """Bind a material to a mesh.

        Parameters
        ----------
        prim : Sdf.PrimSpec
        number : int or None
        colored : bool
            Whether the mesh has colours that the material shows.
        """
        key = (number, colored)
        if key not in self._made:
            self._made[key] = self._make(self.of(number), colored=colored)
        prim.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=["MaterialBindingAPI"]))
        binding = Sdf.RelationshipSpec(prim, "material:binding", custom=False)
        binding.targetPathList.explicitItems = [self._made[key]]

    def _make(self, look: Material, *, colored: bool) -> Sdf.Path:
        path = f"{self._scope}/{self._names.make(self._scope, look.name, 'Material')}"
        material = self._layer.prim(path, "Material", look.name)
        output = attribute(material, "outputs:surface", _TYPES.Token)
        connect(output, _Network(self._layer, path, look, self._textures, colored=colored).surface)
        return material.path


class _Network:
    """The shaders of one material. `surface` is the output to connect the material to."""

    def __init__(self, layer: Layer, path: str, look: Material, textures: Textures, *, colored: bool) -> None:
        self._layer, self._path, self._look, self._textures, self._colored = layer, path, look, textures, colored
        self._shaders: dict[str, Sdf.PrimSpec] = {}
        self._surface = self._shader("Surface", "UsdPreviewSurface")
        self.surface = self._output(self._surface, "surface", _TYPES.Token)
        self._base()
        if look.unlit:  # emission only, no reflection
            self._set("useSpecularWorkflow", _TYPES.Int, 1)
            self._set("specularColor", _TYPES.Color3f, Gf.Vec3f(0.0))
            self._set("diffuseColor", _TYPES.Color3f, Gf.Vec3f(0.0))
            self._set("roughness", _TYPES.Float, 1.0)
            return
        self._metallic_roughness()
        self._emissive()
        self._normal()
        self._occlusion()
        if look.ior != 1.5:
            self._set("ior", _TYPES.Float, look.ior)

    def _base(self) -> None:
        look, name = self._look, "emissiveColor" if self._look.unlit else "diffuseColor"
        texture = self._texture("base_color", "sRGB", scale=look.base_color)
        if texture is not None:
            self._connect(name, _TYPES.Color3f, texture, "rgb")
        elif self._colored:
            reader = self._reader("VertexColor", "UsdPrimvarReader_float3", "displayColor")
            self._connect(name, _TYPES.Color3f, reader, "result")
        else:
            self._set(name, _TYPES.Color3f, Gf.Vec3f(*look.base_color[:3]))
        # A mask with cutoff 0 hides nothing, but an opacityThreshold of 0 would mean blending.
        if look.alpha_mode == "BLEND" or (look.alpha_mode == "MASK" and look.alpha_cutoff > 0.0):
            if texture is not None:
                self._connect("opacity", _TYPES.Float, texture, "a")
            elif self._colored:
                reader = self._reader("VertexOpacity", "UsdPrimvarReader_float", "displayOpacity")
                self._connect("opacity", _TYPES.Float, reader, "result")
            else:
                self._set("opacity", _TYPES.Float, look.base_color[3])
            if look.alpha_mode == "MASK":
                self._set("opacityThreshold", _TYPES.Float, look.alpha_cutoff)

    def _metallic_roughness(self) -> None:
        look = self._look
        texture = self._texture("metallic_roughness", "raw", scale=(1.0, look.roughness, look.metallic, 1.0))
        if texture is None:
            self._set("metallic", _TYPES.Float, look.metallic)
            self._set("roughness", _TYPES.Float, look.roughness)
        else:
            self._connect("metallic", _TYPES.Float, texture, "b")
            self._connect("roughness", _TYPES.Float, texture, "g")

    def _emissive(self) -> None:
        look = self._look
        if not any(look.emissive):
            return
        texture = self._texture("emissive", "sRGB", scale=(*look.emissive, 1.0))
        if texture is None:
            self._set("emissiveColor", _TYPES.Color3f, Gf.Vec3f(*look.emissive))
        else:
            self._connect("emissiveColor", _TYPES.Color3f, texture, "rgb")

    def _normal(self) -> None:
        use = self._look.textures.get("normal")
        if use is None:
            return
        # Map 0..1 to -1..1; the strength scales only x and y.
        scale, bias = (2 * use.strength, 2 * use.strength, 2.0, 1.0), (-use.strength, -use.strength, -1.0, 0.0)
        texture = self._texture("normal", "raw", scale=scale, bias=bias)
        if texture is not None:
            self._connect("normal", _TYPES.Normal3f, texture, "rgb")

    def _occlusion(self) -> None:
        use = self._look.textures.get("occlusion")
        if use is None:
            return
        # 1 + strength (texture - 1)
        scale, bias = (use.strength,) * 3 + (1.0,), (1.0 - use.strength,) * 3 + (0.0,)
        texture = self._texture("occlusion", "raw", scale=scale, bias=bias)
        if texture is not None:
            self._connect("occlusion", _TYPES.Float, texture, "r")

    def _texture(
        self,
        slot: str,
        space: str,
        *,
        scale: tuple[float, ...] = _ONE,
        bias: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
    ) -> Sdf.PrimSpec | None:
        use = self._look.textures.get(slot)
        path = None if use is None else self._textures.path(use.image)
        if use is None or path is None:
            return None
        name = "".join(part.capitalize() for part in slot.split("_"))
        shader = self._shader(name, "UsdUVTexture")
        _input(shader, "file", _TYPES.Asset, Sdf.AssetPath(path))
        _input(shader, "sourceColorSpace", _TYPES.Token, space)
        for side, wrap in zip(("wrapS", "wrapT"), use.wrap, strict=True):
            _input(shader, side, _TYPES.Token, wrap)
        if scale != _ONE:
            _input(shader, "scale", _TYPES.Float4, Gf.Vec4f(*scale))
        if any(bias):
            _input(shader, "bias", _TYPES.Float4, Gf.Vec4f(*bias))
        connect(_input(shader, "st", _TYPES.Float2), self._coordinates(name, use))
        return shader

    def _coordinates(self, name: str, use: TextureUse) -> Sdf.AttributeSpec:
        variable = texcoord_name(use.texcoord)
        reader = self._output(self._reader(variable, "UsdPrimvarReader_float2", variable), "result", _TYPES.Float2)
        if (use.offset, use.rotation, use.scale) == ((0.0, 0.0), 0.0, (1.0, 1.0)):
            return reader
        # glTF rotates and scales about the upper left corner, USD about the lower left one, in the same direction.
        (x, y), (across, down) = use.offset, use.scale
        sine, cosine = math.sin(use.rotation), math.cos(use.rotation)
        shader = self._shader(f"{name}Transform", "UsdTransform2d")
        connect(_input(shader, "in", _TYPES.Float2), reader)
        _input(shader, "scale", _TYPES.Float2, Gf.Vec2f(across, down))
        _input(shader, "rotation", _TYPES.Float, math.degrees(use.rotation))
        _input(shader, "translation", _TYPES.Float2, Gf.Vec2f(x + sine * down, 1.0 - y - cosine * down))
        return self._output(shader, "result", _TYPES.Float2)

    def _reader(self, name: str, kind: str, variable: str) -> Sdf.PrimSpec:
        if name not in self._shaders:
            _input(self._shader(name, kind), "varname", _TYPES.String, variable)
        return self._shaders[name]

    def _shader(self, name: str, kind: str) -> Sdf.PrimSpec:
        shader = self._shaders[name] = self._layer.prim(f"{self._path}/{name}", "Shader")
        attribute(shader, "info:id", _TYPES.Token, kind, uniform=True)
        return shader

    def _output(self, shader: Sdf.PrimSpec, name: str, kind: Any) -> Sdf.AttributeSpec:
        made = shader.attributes.get(f"outputs:{name}")
        return made if made is not None else attribute(shader, f"outputs:{name}", kind)

    def _set(self, name: str, kind: Any, value: Any) -> None:
        _input(self._surface, name, kind, value)

    def _connect(self, name: str, kind: Any, source: Sdf.PrimSpec, output: str) -> None:
        """Connect an input of the surface, with three channels for a colour or normal and one for anything else."""
        made = _TYPES.Float if kind == _TYPES.Float else _TYPES.Float3
        connect(_input(self._surface, name, kind), self._output(source, output, made))


def _input(shader: Sdf.PrimSpec, name: str, kind: Any, value: Any = None) -> Sdf.AttributeSpec:
    return attribute(shader, f"inputs:{name}", kind, value)
