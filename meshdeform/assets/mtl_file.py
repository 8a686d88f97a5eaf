"""Write the materials of a scene as a material library (MTL) with its textures.

Source: Wavefront, MTL material format; the PBR extension (`Pr`, `Pm`, `norm`).
"""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.materials import Image, Material, TextureUse
from meshdeform.assets.scene import ScenePrimitive, SceneView
from meshdeform.assets.texcoords import moved_texcoords
from meshdeform.errors import AssetError

__all__ = ["MaterialLibrary", "line_name"]

_INVALID = re.compile(r"[\s\x00-\x1f\x7f#\\]+")
_LONGEST = 120
# The slots of a material, in the order in which one decides about the texture coordinates, and their statements.
# glTF keeps roughness in green and metallic in blue of one picture.
_STATEMENTS = {
    "base_color": ("map_Kd",),
    "emissive": ("map_Ke",),
    "normal": ("norm",),
    "metallic_roughness": ("map_Pr -imfchan g", "map_Pm -imfchan b"),
}


def line_name(wanted: str, taken: set[str], otherwise: str) -> str:
    """Return a name that a line of OBJ or MTL can hold and that is not taken yet, and add it to those taken.

    Parameters
    ----------
    wanted : str
        The asset's name. May be empty or contain any character.
    taken : set of str
    otherwise : str
        The name to use for an empty one.
    """
    # JSON can contain half of a surrogate pair, which cannot be encoded as UTF-8.
    name = made = _INVALID.sub("_", wanted)[:_LONGEST].encode("utf-8", "replace").decode() or otherwise
    number = 1
    while made in taken:
        number += 1
        made = f"{name}_{number}"
    taken.add(made)
    return made


class MaterialLibrary:
    """Names the materials that primitives use, and writes them with their textures.

    Parameters
    ----------
    scene : SceneView
    """

    def __init__(self, scene: SceneView) -> None:
        self._scene = scene
        self._names: dict[int | None, str] = {}
        self._taken: set[str] = set()
        self._images: dict[int, str] = {}  # paths by the images' numbers; empty for those left out
        self._textures: dict[str, bytes] = {}
        self._left_out: Counter[str] = Counter()

    @property
    def left_out(self) -> dict[str, int]:
        """What materials and primitives have and the library does not, with counts, after `files`."""
        return dict(self._left_out)

    def use(self, number: int | None) -> str | None:
        """Return the name of a primitive's material, or None if the scene has no materials at all."""
        if not self._scene.materials:
            return None
        if number not in self._names:
            wanted = "default" if number is None else self._scene.materials[number].name
            self._names[number] = line_name(wanted, self._taken, f"material{number}")
        return self._names[number]

    def coordinates(self, primitive: ScenePrimitive) -> NDArray[np.float64] | None:
        """Return a primitive's texture coordinates (V, 2) with v upwards, as its material's textures need them."""
        use = _deciding(self._look(primitive.material))
        values = primitive.texcoords.get(use.texcoord if use else 0)
        self._left_out["further sets of texture coordinates"] += max(0, len(primitive.texcoords) - 1)
        if values is None:
            return None
        u, v = (values.astype(np.float64) if use is None else moved_texcoords(values, use)).T
        return np.stack([u, 1.0 - v], axis=1)

    def files(self, stem: str) -> dict[str, bytes]:
        """Return `STEM.mtl` and the textures by their paths; nothing if no material is used."""
        if not self._names:
            return {}
        lines = [f"# Meshdeform {__version__}"]
        for number, name in self._names.items():
            lines += ["", f"newmtl {name}", *self._material(self._look(number))]
        return {f"{stem}.mtl": "\n".join([*lines, ""]).encode(), **self._textures}

    def _look(self, number: int | None) -> Material:
        return Material() if number is None else self._scene.materials[number]

    def _material(self, look: Material) -> list[str]:
        opaque = look.alpha_mode == "OPAQUE"
        lines = [
            f"illum {0 if look.unlit else 2}",
            f"Kd {_numbers(look.base_color[:3])}",
            f"d {_numbers((1.0 if opaque else look.base_color[3],))}",
            f"Ke {_numbers(look.emissive)}",
            f"Ni {_numbers((look.ior,))}",
            f"Pr {_numbers((look.roughness,))}",
            f"Pm {_numbers((look.metallic,))}",
        ]
        decides = _deciding(look)
        for slot, use in look.textures.items():
            statements = _STATEMENTS.get(slot)
            if statements is None:
                self._left_out[f"{slot} textures"] += 1
                continue
            if decides is not None and _place(use) != _place(decides):
                self._left_out["textures with other coordinates than the base colour"] += 1
                continue
            path = self._image(use.image)
            if not path:
                continue
            clamp = " -clamp on" if use.wrap == ("clamp", "clamp") else ""
            lines += [f"{statement}{clamp} {path}" for statement in statements]
            if slot == "base_color" and not opaque:
                lines.append(f"map_d -imfchan m{clamp} {path}")
        return lines

    def _image(self, number: int) -> str:
        if number not in self._images:
            try:
                image = self._scene.image(number)
            except AssetError:  # the deformation did not need the image: leave it out instead of failing
                image = Image(b"", "")
            kept = bool(image.data and image.kind)
            self._images[number] = path = f"textures/image{number}.{image.kind}" if kept else ""
            if kept:
                self._textures[path] = image.data
            else:
                self._left_out["images that are broken or neither PNG, JPEG nor WebP"] += 1
        return self._images[number]


def _deciding(look: Material) -> TextureUse | None:
    """Return the texture whose coordinates are written: an OBJ has one set for all."""
    return next((look.textures[slot] for slot in _STATEMENTS if slot in look.textures), None)


def _place(use: TextureUse) -> tuple[object, ...]:
    return use.texcoord, use.offset, use.rotation, use.scale


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
