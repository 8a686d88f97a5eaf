"""Write what a scene shows as 3MF, with colours and textures.

A model of XML in a ZIP. trimesh writes no colours, and lib3mf has no build for Linux on ARM; the tests read the files
with it. Corners in one position are one vertex, as slicers need them to see a closed surface.

Sources: 3MF Core Specification 1.3; Materials and Properties Extension 1.2.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import groupby
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.appearance import moved_texcoords
from meshdeform.assets.build import far_origin
from meshdeform.assets.frame import UNITS, FileFrame
from meshdeform.assets.materials import TextureUse
from meshdeform.assets.scene import MaterialTriangles, Scene
from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.srgb import srgb_from_linear
from meshdeform.support.files import zipped

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
_RELATION = "http://schemas.openxmlformats.org/package/2006/relationships"
_MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_TEXTURE_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dtexture"
_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'
_TYPES = (
    f'{_HEAD}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    '<Default Extension="png" ContentType="image/png"/><Default Extension="jpg" ContentType="image/jpeg"/></Types>'
)
_CONTROL = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_TILES = {"repeat": "wrap", "mirror": "mirror", "clamp": "clamp"}
_WHITE = (1.0, 1.0, 1.0)


def write_3mf(scene: Scene, frame: FileFrame) -> tuple[bytes, int]:
    """Write a scene as 3MF: an object for each instance of a mesh. The same scene gives the same bytes.

    Returns the file and its number of triangles. Raises AssetEmptyError: nothing is shown.
    """
    model = _Model(scene, frame)
    for _, pieces in groupby(scene.placed(), lambda piece: piece.instance):
        model.add(list(pieces))
    if not model.triangles:
        raise AssetEmptyError("The asset has no triangles that a 3MF could hold.")
    return zipped(model.files()), model.triangles


class _Model:
    """The XML of a model, and the textures that it uses."""

    def __init__(self, scene: Scene, frame: FileFrame) -> None:
        self._scene, self._frame = scene, frame
        self._resources: list[str] = []
        self._objects: list[int] = []
        self._textures: dict[tuple[object, ...], int] = {}  # resource of each image with its tiling
        self._images: dict[str, bytes] = {}
        self._told: set[int] = set()
        self._next = 0
        self.triangles = 0

    def add(self, pieces: list[MaterialTriangles]) -> None:
        """Add the pieces of one instance as an object."""
        positions = self._frame.points(np.concatenate([piece.positions for piece in pieces]))
        starts = np.cumsum([0, *(len(piece.positions) for piece in pieces)])
        origin = far_origin([positions])
        precise = positions if origin is not None else positions.astype(np.float32) + np.float32(0)  # -0.0 is 0.0
        verts, at = np.unique(precise, axis=0, return_inverse=True)
        lines: list[str] = []
        for piece, start in zip(pieces, starts, strict=False):
            corners = at.reshape(-1)[start + piece.triangles]
            whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
            self._scene.lost["triangles without area, which 3MF forbids"] += int((~whole).sum())
            if whole.any():
                lines += self._faces(piece, corners[whole], piece.triangles[whole])
        if not lines:
            return
        digits = "%.9g" if origin is None else "%.15g"
        vertex = f'<vertex x="{digits}" y="{digits}" z="{digits}"/>\n'
        vertices = (vertex * len(verts)) % tuple(verts.astype(np.float64).reshape(-1).tolist())
        number = self._number()
        self._objects.append(number)
        name = quoteattr(_CONTROL.sub("", pieces[0].name) or f"node{pieces[0].instance[0]}")
        mesh = ["<mesh><vertices>\n", vertices, "</vertices><triangles>\n", *lines, "</triangles></mesh>"]
        self._resources.append(f'<object id="{number}" type="model" name={name}>{"".join(mesh)}</object>\n')

    def _faces(self, piece: MaterialTriangles, corners: NDArray[np.int64], own: NDArray[np.int64]) -> Iterator[str]:
        """Yield triangles (T, 3): vertices of the object, and the rows of the piece whose colours they have."""
        self.triangles += len(corners)
        resource, properties = self._look(piece)
        if resource is None:
            yield ('<triangle v1="%d" v2="%d" v3="%d"/>\n' * len(corners)) % tuple(corners.reshape(-1).tolist())
            return
        line = f'<triangle v1="%d" v2="%d" v3="%d" pid="{resource}" p1="%d" p2="%d" p3="%d"/>\n'
        rows = np.concatenate([corners, properties[own]], axis=1)
        yield (line * len(rows)) % tuple(rows.reshape(-1).tolist())

    def _look(self, piece: MaterialTriangles) -> tuple[int | None, NDArray[np.int64]]:
        """Return the resource of colours or texture coordinates of a piece, and the entry (V,) of each vertex."""
        shading = self._scene.shading(piece.material)
        factor = np.array(shading.base.base_color)
        colors = np.ones((len(piece.positions), 4)) if piece.colors is None else piece.colors.astype(np.float64)
        colors = colors * factor
        if piece.material is not None and piece.material not in self._told:
            self._told.add(piece.material)
            self._scene.lost["all of materials but their base colours"] += 1
        use = shading.textures.get("base_color")
        texcoords = piece.texcoords.get(use.texcoord) if use is not None else None
        if use is not None and texcoords is not None:
            texture = self._texture(use)
            if texture is not None:
                if (colors[:, :3] != _WHITE).any():
                    self._scene.lost["colours that tint a texture"] += 1
                return self._coordinates(texture, moved_texcoords(texcoords, use))
        if piece.material is None and piece.colors is None:
            return None, np.empty(0, np.int64)
        if shading.base.alpha_mode == "OPAQUE":
            colors[:, 3] = 1.0
        encoded = np.column_stack([srgb_from_linear(np.clip(colors[:, :3], 0, 1)), np.clip(colors[:, 3:], 0, 1)])
        shades, at = np.unique(np.round(255 * encoded).astype(np.uint8), axis=0, return_inverse=True)
        number = self._number()
        entries = "".join(f'<m:color color="#{shade.tobytes().hex().upper()}"/>' for shade in shades)
        self._resources.append(f'<m:colorgroup id="{number}">{entries}</m:colorgroup>\n')
        return number, at.reshape(-1)

    def _texture(self, use: TextureUse) -> int | None:
        data, kind = self._scene.image(use.image)
        if not data:
            return None
        key = use.image, use.wrap, use.nearest
        if key not in self._textures:
            path = f"3D/Textures/image{use.image}.{kind}"
            self._images[path] = data
            media = "image/png" if kind == "png" else "image/jpeg"
            u, v = (_TILES[side] for side in use.wrap)
            self._textures[key] = number = self._number()
            style = f'tilestyleu="{u}" tilestylev="{v}" filter="{"nearest" if use.nearest else "auto"}"'
            self._resources.append(f'<m:texture2d id="{number}" path="/{path}" contenttype="{media}" {style}/>\n')
        return self._textures[key]

    def _coordinates(self, texture: int, texcoords: NDArray[np.float64]) -> tuple[int, NDArray[np.int64]]:
        number = self._number()
        u, v = texcoords.T
        rows = np.stack([u, 1.0 - v], axis=1)
        entries = ('<m:tex2coord u="%.9g" v="%.9g"/>' * len(rows)) % tuple(rows.reshape(-1).tolist())
        self._resources.append(f'<m:texture2dgroup id="{number}" texid="{texture}">{entries}</m:texture2dgroup>\n')
        return number, np.arange(len(rows))

    def _number(self) -> int:
        self._next += 1
        return self._next

    def files(self) -> dict[str, bytes | str]:
        """Return the files of the package by their names."""
        items = "".join(f'<item objectid="{number}"/>' for number in self._objects)
        said = escape(_CONTROL.sub("", " ".join(self._scene.sentences())))
        described = f'<metadata name="Description">{said}</metadata>' if said else ""
        unit = UNITS[self._frame.unit][0]
        model = [
            f'{_HEAD}<model unit="{unit}" xml:lang="en-US" xmlns="{_CORE}" xmlns:m="{_MATERIAL}">',
            f'<metadata name="Application">Meshdeform {__version__}</metadata>{described}<resources>\n',
            *self._resources,
            f"</resources><build>{items}</build></model>",
        ]
        files: dict[str, bytes | str] = {
            "[Content_Types].xml": _TYPES,
            "_rels/.rels": _relations([("/3D/3dmodel.model", _MODEL_TYPE)]),
            "3D/3dmodel.model": "".join(model),
        }
        if self._images:
            textures = [(f"/{path}", _TEXTURE_TYPE) for path in self._images]
            files |= {"3D/_rels/3dmodel.model.rels": _relations(textures), **self._images}
        return files


def _relations(targets: Iterable[tuple[str, str]]) -> str:
    lines = [f'<Relationship Target="{path}" Id="r{k}" Type="{kind}"/>' for k, (path, kind) in enumerate(targets)]
    return f'{_HEAD}<Relationships xmlns="{_RELATION}">{"".join(lines)}</Relationships>'
