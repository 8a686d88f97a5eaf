"""Read the material libraries (MTL) of an OBJ: colours, opacity, and the names of base colour textures. Pure Python.

trimesh splits the faces by material, but decodes textures and drops the names of materials without a library. So it
gets a library of names alone, and the values are read here.

Source: Wavefront, MTL material format; the PBR extension (`Pm`, `Pr`).
"""

from __future__ import annotations

import posixpath
import re
from dataclasses import dataclass

from meshdeform.assets.archive import Archive

__all__ = ["LIBRARY", "ObjMaterial", "library_of_names", "read_obj_materials"]

LIBRARY = "materials.mtl"
_USED = re.compile(rb"^[ \t]*usemtl[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_LINKED = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_COLORED = re.compile(rb"^[ \t]*v(?:[ \t]+[-+.0-9eE]+){6,}[ \t\r]*$", re.MULTILINE)


@dataclass
class ObjMaterial:
    """A material of an OBJ.

    Attributes
    ----------
    base_color : tuple of 4 floats or None
        `Kd` and `d`, taken as linear; None if the library does not have them.
    texture : bytes
        The encoded image of `map_Kd`; empty if there is none.
    """

    base_color: tuple[float, float, float, float] | None = None
    metallic: float = 0.0
    roughness: float = 0.8
    texture: bytes = b""


def library_of_names(data: bytes) -> bytes:
    """Return a library with every material that an OBJ uses; empty if there is none, or vertices have colours."""
    if _COLORED.search(data):
        return b""
    names = dict.fromkeys(_USED.findall(data))
    return b"".join(b"newmtl %s\n" % name for name in names)


def read_obj_materials(data: bytes, archive: Archive | None) -> dict[str, ObjMaterial]:
    """Return the materials that an OBJ uses, with the values that its libraries in the archive give them."""
    found = {_text(name): ObjMaterial() for name in _USED.findall(data)}
    for link in _LINKED.findall(data) if archive else []:
        assert archive is not None
        library = archive.find(_text(link))
        if library is not None:
            beside = posixpath.normpath(posixpath.join(posixpath.dirname(archive.main), _text(link)))
            _read_library(_text(library), archive, beside, found)
    return found


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace").strip()


def _read_library(text: str, archive: Archive, beside: str, found: dict[str, ObjMaterial]) -> None:
    material = ObjMaterial()
    color, alpha = (1.0, 1.0, 1.0), 1.0
    for line in text.splitlines():
        key, _, value = line.strip().partition(" ")
        key, value = key.lower(), value.strip()
        if key == "newmtl":
            material, color, alpha = found.get(value, ObjMaterial()), (1.0, 1.0, 1.0), 1.0
        elif key == "map_kd":
            # Options such as `-s 1 1 1` come before the name; a name may contain spaces.
            image = archive.find(value, beside) or archive.find(value.split(" ")[-1], beside)
            material.texture = image or b""
        numbers = _numbers(value)
        if key == "kd" and len(numbers) >= 3:
            color = (numbers[0], numbers[1], numbers[2])
        elif key == "d" and numbers:
            alpha = numbers[0]
        elif key == "tr" and numbers:
            alpha = 1.0 - numbers[0]
        elif key == "pm" and numbers:
            material.metallic = numbers[0]
        elif key == "pr" and numbers:
            material.roughness = numbers[0]
        if key in {"kd", "d", "tr"}:
            material.base_color = (*color, alpha)


def _numbers(text: str) -> list[float]:
    """Return the leading numbers of a line, each limited to 0..1."""
    found = []
    for word in text.split():
        try:
            value = float(word)
        except ValueError:
            break
        if value != value:
            break
        found.append(min(max(value, 0.0), 1.0))
    return found
