"""Write what a scene shows as Wavefront OBJ, with its material library and textures.

trimesh's exporter is not used: it encodes textures anew, rounds coordinates, and mixes up the corners of scenes in
which only some meshes have texture coordinates.

Sources: Wavefront, Object files (.obj) and MTL material format; the PBR extension (`Pr`, `Pm`, `norm`); vertex colours
after the position, as MeshLab and Blender read them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.appearance import moved_texcoords
from meshdeform.assets.build import far_origin
from meshdeform.assets.frame import FileFrame
from meshdeform.assets.materials import Shading, TextureUse
from meshdeform.assets.scene import MaterialTriangles, Scene
from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.srgb import srgb_from_linear

_INVALID = re.compile(r"[\s\x00-\x1f\x7f#\\]+")
_LONGEST = 120
_STATEMENTS = {
    "base_color": ("map_Kd",),
    "emissive": ("map_Ke",),
    "normal": ("norm",),
    "metallic_roughness": ("map_Pr -imfchan g", "map_Pm -imfchan b"),
}
"""The textures of a material, in the order in which one decides about the texture coordinates, of which an OBJ has one
set. glTF keeps roughness in green and metallic in blue of one picture."""
_KINDS = ("png", "jpg", "webp")


def write_obj(scene: Scene, frame: FileFrame, stem: str) -> tuple[dict[str, bytes], int]:
    """Write a scene as OBJ: an object for each instance of a mesh, with a material for each primitive.

    `stem`: the files are `STEM.obj`, `STEM.mtl` and `STEM_textures/...`, named without spaces inside, which the format
    cannot name. Returns the files by their names relative to the OBJ, which comes first, and the number of triangles.
    Numbers have as many digits as it takes to read the same 32-bit floats. Raises AssetEmptyError: nothing is shown.
    """
    linked = _line_name(stem, set(), "result")
    library = _Library(scene, linked)
    taken, lines, counts, triangles = set[str](), list[str](), np.ones(3, np.int64), 0
    at: tuple[int, int] | None = None
    for piece in scene.placed():
        if piece.instance != at:
            at = piece.instance
            lines.append(f"o {_line_name(piece.name, taken, f'node{at[0]}')}\n")
        lines += _piece(piece, library, frame, counts)
        triangles += len(piece.triangles)
    if not triangles:
        raise AssetEmptyError("The asset has no triangles that an OBJ could hold.")
    files = library.files()
    head = [f"# Meshdeform {__version__}: {triangles:,} triangles in {frame.words}\n"]
    head += [f"# {sentence}\n" for sentence in scene.sentences()]
    head += [f"mtllib {linked}.mtl\n"] if files else []
    return {f"{stem}.obj": "".join([*head, *lines]).encode(), **files}, triangles


def _piece(piece: MaterialTriangles, library: _Library, frame: FileFrame, counts: NDArray[np.int64]) -> Iterator[str]:
    """Yield the text of a piece, and advance the counts of positions, texture coordinates and normals."""
    name = library.use(piece.material)
    if name is not None:
        yield f"usemtl {name}\n"
    positions = frame.points(piece.positions)
    digits = "%.9g" if far_origin([positions]) is None else "%.15g"
    shading = library.scene.shading(piece.material)
    columns = positions
    if piece.colors is not None and "base_color" not in shading.textures:
        columns = np.column_stack([positions, srgb_from_linear(piece.colors[:, :3].astype(np.float64))])
    elif piece.colors is not None and (piece.colors != 1).any():
        library.scene.lost["colours of vertices beside a texture"] += 1
    values = [columns, library.coordinates(piece), None if piece.normals is None else frame.directions(piece.normals)]
    yield _rows("v", columns, digits)
    used = [0]
    for k, key in ((1, "vt"), (2, "vn")):
        rows = values[k]
        if rows is not None:
            yield _rows(key, rows, "%.9g")
            used.append(k)
    corners = np.stack([piece.triangles + counts[k] for k in used], axis=-1).reshape(len(piece.triangles), -1)
    corner = {(0,): "%d", (0, 1): "%d/%d", (0, 2): "%d//%d", (0, 1, 2): "%d/%d/%d"}[tuple(used)]
    yield (f"f {corner} {corner} {corner}\n" * len(corners)) % tuple(corners.reshape(-1).tolist())
    counts[used] += len(positions)


def _rows(key: str, values: NDArray[np.floating], digits: str) -> str:
    line = " ".join([key, *[digits] * values.shape[1]]) + "\n"
    return (line * len(values)) % tuple(values.reshape(-1).tolist())


def _line_name(wanted: str, taken: set[str], otherwise: str) -> str:
    """Return a name that a line of OBJ or MTL can hold and that is not taken yet, and add it to those taken."""
    # JSON can contain half of a surrogate pair, which cannot be encoded as UTF-8.
    name = made = _INVALID.sub("_", wanted)[:_LONGEST].encode("utf-8", "replace").decode() or otherwise
    number = 1
    while made in taken:
        number += 1
        made = f"{name}_{number}"
    taken.add(made)
    return made


class _Library:
    """Names the materials that pieces use, and writes them with their textures."""

    def __init__(self, scene: Scene, stem: str) -> None:
        self.scene, self._stem = scene, stem
        self._names: dict[int | None, str] = {}
        self._taken: set[str] = set()
        self._textures: dict[str, bytes] = {}

    def use(self, material: int | None) -> str | None:
        """Return the name of a material; None if the scene has no materials at all."""
        if not self.scene.root.get("materials"):
            return None
        if material not in self._names:
            wanted = "default" if material is None else self.scene.shading(material).name
            self._names[material] = _line_name(wanted, self._taken, f"material{material}")
        return self._names[material]

    def coordinates(self, piece: MaterialTriangles) -> NDArray[np.float64] | None:
        """Return texture coordinates (V, 2) with v upwards, as the textures of the piece's material need them."""
        use = _deciding(self.scene.shading(piece.material))
        self.scene.lost["further sets of texture coordinates"] += max(0, len(piece.texcoords) - 1)
        values = piece.texcoords.get(use.texcoord if use else 0)
        if values is None:
            return None
        u, v = (values.astype(np.float64) if use is None else moved_texcoords(values, use)).T
        return np.stack([u, 1.0 - v], axis=1)

    def files(self) -> dict[str, bytes]:
        """Return the library and the textures by their names; nothing if no material is used."""
        if not self._names:
            return {}
        lines = [f"# Meshdeform {__version__}"]
        for material, name in self._names.items():
            lines += ["", f"newmtl {name}", *self._material(self.scene.shading(material))]
        return {f"{self._stem}.mtl": "\n".join([*lines, ""]).encode(), **self._textures}

    def _material(self, look: Shading) -> list[str]:
        base, opaque = look.base, look.base.alpha_mode == "OPAQUE"
        color = srgb_from_linear(np.array(base.base_color[:3]))
        lines = [
            f"illum {0 if base.unlit else 2}",
            f"Kd {_numbers(color)}",
            f"d {1.0 if opaque else base.base_color[3]:.9g}",
            f"Ke {_numbers(srgb_from_linear(np.clip(look.emissive, 0.0, 1.0)))}",
            f"Ni {look.ior:.9g}",
            f"Pr {look.roughness:.9g}",
            f"Pm {look.metallic:.9g}",
        ]
        lines += [f"Pc {look.clearcoat:.9g}", f"Pcr {look.clearcoat_roughness:.9g}"] if look.clearcoat else []
        decides = _deciding(look)
        for slot, use in look.textures.items():
            if slot not in _STATEMENTS:
                self.scene.lost["occlusion textures"] += 1
            elif decides is not None and _coordinates_of(use) != _coordinates_of(decides):
                self.scene.lost["textures with other coordinates than the base colour"] += 1
            else:
                lines += self._maps(look, slot, use)
        return lines

    def _maps(self, look: Shading, slot: str, use: TextureUse) -> list[str]:
        data, kind = self.scene.image(use.image, _KINDS)
        if not data:
            return []
        path = f"{self._stem}_textures/image{use.image}.{kind}"
        self._textures[path] = data
        options = " -clamp on" if use.wrap == ("clamp", "clamp") else ""
        strength = f" -bm {look.normal_scale:.9g}" if slot == "normal" and look.normal_scale != 1 else ""
        lines = [f"{statement}{options}{strength} {path}" for statement in _STATEMENTS[slot]]
        if slot == "base_color" and look.base.alpha_mode != "OPAQUE":
            lines.append(f"map_d -imfchan m{options} {path}")
        return lines


def _deciding(look: Shading) -> TextureUse | None:
    """Return the texture whose coordinates are written."""
    return next((look.textures[slot] for slot in _STATEMENTS if slot in look.textures), None)


def _coordinates_of(use: TextureUse) -> tuple[object, ...]:
    return use.texcoord, use.offset, use.rotation, use.scale


def _numbers(values: NDArray[np.floating]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
