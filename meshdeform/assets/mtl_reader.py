"""Read the material libraries (MTL) of an OBJ.

Base colour, opacity, emission, metal and roughness become those of glTF, with textures of base colour, emission and
normals, and how they lie (`-s`, `-o`, `-clamp`). A shininess `Ns` without `Pr` becomes a roughness as Blender writes
it. All else is told, unless it has the value that programs write by default.

Source: Wavefront, MTL material format; the PBR extension (`Pm`, `Pr`, `norm`).
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from dataclasses import dataclass

from meshdeform.assets.archive import Archive, not_found, not_readable
from meshdeform.assets.build import Picture, linear_color
from meshdeform.assets.materials import portable_picture
from meshdeform.assets.other_formats import plain_text

__all__ = ["Libraries", "MtlMaterial", "linked_pictures"]

# `-s 1 1 1`, `-mm 0 1`, `-clamp on`: options of a texture come before its name.
_OPTION = re.compile(r"-([ost])((?: +[-+.\deE]+){1,3}) +|-(mm)( +\S+ +\S+) +|-([a-z]+)( +\S+) +", re.IGNORECASE)
_TEXTURES = {"map_kd": "texture", "map_ke": "emission_texture", "norm": "normal_map", "map_kn": "normal_map"}
"""Statements of textures that are read, and what they are of a material."""
_OTHER_TEXTURES = ("map_", "bump", "disp", "decal", "refl")
_OTHERS = {
    "ks": (0.0, 0.5, 1.0),
    "ka": (0.0, 0.2, 1.0),
    "tf": (1.0,),
    "ni": (1.0, 1.45, 1.5),
    **dict.fromkeys(("pc", "pcr", "ps", "aniso", "anisor"), (0.0,)),
    "sharpness": (60.0,),
}
"""Statements that are not read, and what programs write where nobody has set them."""
_SILENT_OPTIONS = frozenset(("blendu", "blendv", "texres", "s", "o", "clamp"))
_SHINIEST = 1000.0
_MOST = 1e4


@dataclass
class MtlMaterial:
    """What a library says of a material; without one, what programs show."""

    base_color: tuple[float, float, float, float] | None = None
    metallic: float = 0.0
    roughness: float = 0.8
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    texture: Picture | None = None
    emission_texture: Picture | None = None
    normal_map: Picture | None = None
    tinted: bool = False
    """Whether `Kd` is no grey. Beside a texture, programs write a grey that they do not use."""

    @property
    def shown_color(self) -> tuple[float, float, float, float] | None:
        """The linear factor of the texture, or the colour where there is none."""
        if self.base_color is None or self.tinted or self.texture is None:
            return self.base_color
        return (1.0, 1.0, 1.0, self.base_color[3])

    @property
    def shown_emission(self) -> tuple[float, float, float]:
        """The linear factor of the texture of emission, which is wholly on where nothing else is said, or the light."""
        return (1.0, 1.0, 1.0) if self.emission_texture and not any(self.emission) else self.emission


def linked_pictures(library: bytes) -> list[str]:
    """Return the paths, relative to a material library, that the textures that are read may have."""
    return [path for key, value in _statements(library) if key in _TEXTURES for path in _picture_paths(value)]


class Libraries:
    """Reads material libraries into the materials that an OBJ uses, and notes what was not found or is not read."""

    def __init__(self, archive: Archive, looks: dict[str, MtlMaterial]) -> None:
        self._archive, self._looks = archive, looks
        self._libraries: list[str] = []
        self._pictures: dict[str, None] = {}
        self._unreadable: dict[str, None] = {}
        self._left_out: dict[str, None] = {}
        self._described: dict[str, None] = {}

    def read_line(self, value: str) -> None:
        """Read the libraries of an `mtllib` line: it may list several, or one whose name has spaces."""
        for names in ([value], value.split()):
            files = [(name, self._archive.find(name)) for name in names]
            if any(library is not None for _, library in files):
                break
        for name, library in files:
            if library is None:
                self._libraries.append(name)
            else:
                self._read(library, posixpath.join(posixpath.dirname(self._archive.main), name.replace("\\", "/")))

    def notices(self) -> list[str]:
        """Return sentences about what was not found, or is not read."""
        sentences = []
        missing = [name for name in self._looks if name not in self._described]
        if self._libraries and self._looks:
            sentences.append(not_found("Material libraries", self._libraries))
        elif missing:
            sentences.append(not_found("Materials", missing))
        if self._pictures:
            sentences.append(not_found("Textures", list(self._pictures)))
        if self._unreadable:
            sentences.append(not_readable(list(self._unreadable)))
        clear = [name for name, look in self._looks.items() if look.base_color is not None and look.base_color[3] == 0]
        if clear:
            listed = ", ".join(clear[:3]) + (" ..." if len(clear) > 3 else "")
            sentences.append(f"Materials are wholly transparent, so viewers show nothing of what has them: {listed}.")
        if self._left_out:
            kinds = ", ".join(self._left_out)
            sentences.append(f"Of materials, these statements of the MTL are not read, and were left out: {kinds}.")
        return sentences

    def _picture(self, key: str, value: str, beside: str) -> Picture | None:
        """Return the picture of a statement as PNG or JPEG; None if there is none."""
        paths = _picture_paths(value)
        image = next(filter(None, (self._archive.find(path, beside) for path in paths)), b"")
        data = portable_picture(image) if image else b""
        if not data:
            (self._unreadable if image else self._pictures)[paths[0]] = None
            return None
        options = dict(_options(value))
        self._left_out |= dict.fromkeys(f"{key} -{name}" for name in options if name not in _SILENT_OPTIONS)
        across, along = _two(options.get("s"), 1.0)
        right, up = _two(options.get("o"), 0.0)
        # OBJ counts v upwards, glTF downwards.
        offset = right + 0.0, 1.0 - along - up + 0.0
        return Picture(data, (across, along), offset, options.get("clamp", "").strip().lower() == "on")

    def _read(self, library: bytes, beside: str) -> None:
        described: _Described | None = None
        for key, value in _statements(library):
            if key == "newmtl":
                self._described[value] = None
                described = _Described(self._looks[value]) if value in self._looks else None
            elif described is None:
                continue
            elif key in _TEXTURES:
                if _TEXTURES[key] in described.textures:
                    self._left_out[f"all but the last {key}"] = None
                described.textures.add(_TEXTURES[key])
                setattr(described.material, _TEXTURES[key], self._picture(key, value, beside))
            elif key.startswith(_OTHER_TEXTURES):
                self._left_out[key] = None
            elif key in _OTHERS:
                numbers = _numbers(value, _MOST)
                if not numbers or any(number not in _OTHERS[key] for number in numbers):
                    self._left_out[key] = None
            else:
                described.read(key, value)


class _Described:
    """A material while its statements are read."""

    def __init__(self, material: MtlMaterial) -> None:
        self.material, self.textures = material, set[str]()
        self._color = (1.0, 1.0, 1.0)
        self._dissolve: float | None = None
        self._transparency, self._has_roughness = 0.0, False

    def read(self, key: str, value: str) -> None:
        """Take over the numbers of a statement."""
        material, numbers = self.material, _numbers(value)
        if key in {"kd", "ke"} and len(numbers) >= 3:
            if key == "kd":
                self._color = (numbers[0], numbers[1], numbers[2])
            else:
                material.emission = _emission(_numbers(value, _MOST))
        elif key == "d" and numbers:
            self._dissolve = numbers[0]
        elif key == "tr" and numbers:
            self._transparency = numbers[0]
        elif key == "pm" and numbers:
            material.metallic = numbers[0]
        elif key == "pr" and numbers:
            material.roughness, self._has_roughness = numbers[0], True
        elif key == "ns" and numbers and not self._has_roughness:
            material.roughness = 1.0 - (min(_numbers(value, _SHINIEST)[0], _SHINIEST) / _SHINIEST) ** 0.5
        if key in {"kd", "d", "tr"}:
            # `Tr` does not belong to the format, and programs disagree about its sense.
            alpha = 1.0 - self._transparency if self._dissolve is None else self._dissolve
            material.base_color = (*linear_color(self._color), alpha)
            material.tinted = len(set(self._color)) > 1


def _emission(numbers: list[float]) -> tuple[float, float, float]:
    """Return the light of `Ke`: up to 1 a colour as `Kd` is, above it a multiple of one."""
    strength = max(1.0, *numbers[:3])
    red, green, blue = linear_color([number / strength for number in numbers[:3]])
    return red * strength, green * strength, blue * strength


def _statements(library: bytes) -> Iterator[tuple[str, str]]:
    """Yield the keyword, in lower case, and the rest of each line of a material library."""
    for line in plain_text(library).decode("utf-8", "replace").splitlines():
        key, _, value = line.replace("\t", " ").strip().partition(" ")
        yield key.lower(), value.strip()


def _options(value: str) -> Iterator[tuple[str, str]]:
    """Yield the options of a texture, in lower case, and what follows each."""
    at = 0
    while match := _OPTION.match(value, at):
        name, text = (group for group in match.groups() if group is not None)
        yield name.lower(), text
        at = match.end()


def _picture_paths(value: str) -> list[str]:
    """Return the paths that a texture may have: without options, and beside the library if they lead elsewhere."""
    at = 0
    while match := _OPTION.match(value, at):
        at = match.end()
    name = value[at:].replace("\\", "/")
    return list(dict.fromkeys([name, value.rpartition(" ")[2].replace("\\", "/"), posixpath.basename(name)]))


def _two(text: str | None, default: float) -> tuple[float, float]:
    """Return the first two numbers of an option."""
    numbers = []
    for word in (text or "").split()[:2]:
        try:
            numbers.append(float(word))
        except ValueError:
            break
    first, second = [*numbers, *[default] * (2 - len(numbers))]
    return (first, second) if max(abs(first), abs(second)) < _MOST else (default, default)


def _numbers(text: str, most: float = 1.0) -> list[float]:
    """Return the leading numbers of a line, each limited to 0..most."""
    numbers = []
    for word in text.split():
        try:
            value = float(word)
        except ValueError:
            break
        if value != value:
            break
        numbers.append(min(max(value, 0.0), most))
    return numbers
