"""Check the declared sizes of OBJ, PLY and STL files before they are decoded. Pure Python."""

from __future__ import annotations

import codecs
import math
import re
import struct

from meshdeform.assets.container import Data
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetEmptyError, AssetFormatError, AssetTooLargeError, AssetTruncatedError

_WRITE = "bpy.ops.export_scene.gltf(filepath='out.glb')"
_READ_BY_BLENDER = "blender -b --python-expr \"import bpy; bpy.ops.wm.{}(filepath='in.{}'); {}\""
_USD = ("usd", "usda", "usdc", "usdz")
_STEP = "pip install cascadio; python -c \"import cascadio; cascadio.step_to_glb('in.{}', 'out.glb')\""
CONVERTERS = {
    "fbx": "FBX2glTF --binary --input in.fbx --output out.glb",
    **{ending: _READ_BY_BLENDER.format("usd_import", ending, _WRITE) for ending in _USD},
    "abc": _READ_BY_BLENDER.format("alembic_import", "abc", _WRITE),
    "blend": f'blender -b in.blend --python-expr "import bpy; {_WRITE}"',
    **{ending: f"assimp export in.{ending} out.glb" for ending in ("dae", "3ds", "off", "amf", "x3d", "lwo", "ifc")},
    **{ending: _STEP.format(ending) for ending in ("step", "stp")},
    "b3dm": "npx 3d-tiles-tools b3dmToGlb -i in.b3dm -o out.glb",
    "spz": "npx @playcanvas/splat-transform in.spz out.ply, and make a mesh of its points, for example in MeshLab",
    "gz": "gunzip FILE",
    # Its faces look inwards.
    "vdb": "vdb_tool -read in.vdb -ls2mesh -write out.ply && "
    "python -c \"import trimesh; m = trimesh.load('out.ply'); m.invert(); m.export('out.ply')\"",
}
"""Commands that convert files of other formats to GLB or PLY, by file extension."""
_MAGICS = (
    (b"Kaydara FBX Binary", "fbx"),
    (b"PXR-USDC", "usdc"),
    (b"#usda ", "usda"),
    (b"BLENDER", "blend"),
    (b" BDV\0\0\0\0", "vdb"),
    (b"b3dm", "b3dm"),
    (b"ISO-10303-21;", "step"),
    (b"OFF\n", "off"),
    (b"OFF\r", "off"),
    (b"COFF", "off"),
    (b"\x1f\x8b", "gz"),
)

_MAX_PLY_HEADER = 64 * 1024
_OBJ_FACE = re.compile(rb"(?:^|[\r\n])[ \t]*f[ \t]")
_OBJ_VERTEX = re.compile(rb"(?:^|[\r\n])[ \t]*v[ \t]")
_STL_HEAD = 4096
_LEAST_SIZE, _MOST_SIZE = 1e-9, 1e9
_STL_FACET = re.compile(rb"\bfacet\b[^\r\n]*", re.IGNORECASE)


def inspect_foreign(data: Data, kind: str, limits: Limits) -> tuple[int, int]:
    """Return the numbers of vertices and faces that a mesh file declares, or refuse it if too large or empty."""
    vertices, faces = {"obj": _obj_counts, "ply": _ply_counts, "stl": _stl_counts}[kind](data)
    if faces > limits.max_triangles or vertices > limits.max_vertices:
        raise AssetTooLargeError(
            f"The file has {faces} faces and {vertices} vertices; the limits are {limits.max_triangles} "
            f"(MESHDEFORM_MAX_TRIANGLES) and {limits.max_vertices}."
        )
    if faces == 0:
        raise no_triangles("points") if kind == "ply" and vertices else AssetEmptyError("The file has no faces.")
    return vertices, faces


def no_triangles(surface: str) -> AssetEmptyError:
    """Return the error about a file that describes a surface by `points`, a `grid` or a `network`."""
    words = {"points": "points", "grid": "a distance grid", "network": "a network"}[surface]
    return AssetEmptyError(
        f"The file has no triangles: it describes a surface by {words}.",
        advice="Fit a surface to it first, and send that mesh: `meshdeform surface-fit FILE -o mesh.glb`, or a job of "
        "kind surface_fit (docs/surface_fit.md).",
        surface=surface,
    )


def refuse_other_format(head: bytes, ending: str) -> None:
    """Refuse a format that must be converted first, with the command that does it."""
    kind = next((kind for magic, kind in _MAGICS if head.startswith(magic)), ending)
    if kind == "gz" and ending == "spz":  # which is compressed as a whole
        kind = ending
    if kind in CONVERTERS:
        command = CONVERTERS[kind]
        way = "Unpack it" if kind == "gz" else f"Convert it to {'PLY' if 'out.ply' in command else 'GLB'}"
        raise AssetFormatError(
            f"The file is {kind.upper()}, which Meshdeform does not read.", advice=f"{way}: {command}"
        )


def plain_text(data: Data) -> bytes:
    """Return a text as UTF-8 without a byte order mark; one that is no Unicode is taken as Windows-1252."""
    text = bytes(data)
    if text.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return text.decode("utf-16", "replace").encode()
    if not text.isascii():
        try:
            text.decode()
        except UnicodeDecodeError:
            return text.decode("cp1252", "replace").encode()
    return text.removeprefix(codecs.BOM_UTF8)


def _obj_counts(data: Data) -> tuple[int, int]:
    if bytes(data[:2]) in {codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE}:
        data = plain_text(data)
    if b"\0" in bytes(data[:4096]):
        raise AssetFormatError("The file is named .obj, but its content is binary.")
    return sum(1 for _ in _OBJ_VERTEX.finditer(data)), sum(1 for _ in _OBJ_FACE.finditer(data))


def _ply_counts(data: Data) -> tuple[int, int]:
    head = bytes(data[:_MAX_PLY_HEADER])
    end = head.find(b"end_header")
    if end < 0:
        raise AssetTruncatedError("The PLY file has no end_header.")
    counts = {"vertex": 0, "face": 0}
    declared = 0
    for line in head[:end].split(b"\n"):
        words = line.split()
        if len(words) >= 3 and words[0] == b"element":
            if not words[2].isdigit() or len(words[2]) > 15:
                raise AssetFormatError("An element of the PLY header has no count.")
            declared += int(words[2])
            counts[words[1].decode("ascii", "replace")] = int(words[2])
    if declared > len(data):  # an element takes at least one byte in every PLY encoding
        raise AssetTruncatedError(f"The PLY header declares {declared} elements, but the file has {len(data)} bytes.")
    return counts["vertex"], counts["face"] or counts.get("tristrips", 0)  # of strips, their triangles are not counted


def is_ascii_stl(data: Data) -> bool:
    """Return whether an STL file is text; some binary ones start with `solid`, too, and some have bytes after the end.

    Where the size fits the number of facets exactly, or is larger and the head has zeros, it is binary; else a text
    names a facet, or its end, early on.
    """
    head = bytes(data[:_STL_HEAD]).lstrip().lower()
    if not head.startswith(b"solid"):
        return False
    declared = 84 + 50 * int.from_bytes(bytes(data[80:84]), "little")
    if len(data) == declared or (len(data) > declared and b"\0" in bytes(data[:84])):
        return False
    return b"facet" in head or b"endsolid" in head or len(data) < declared


def _stl_counts(data: Data) -> tuple[int, int]:
    if is_ascii_stl(data):
        faces = sum(1 for facet in _STL_FACET.finditer(data) if b"normal" in facet.group().lower())
        return 3 * faces, faces
    if len(data) < 84:
        raise AssetTruncatedError("A binary STL file has at least 84 bytes.")
    declared, faces = stl_facets(data)
    if len(data) < 84 + 50 * declared:
        raise AssetTruncatedError(
            f"The STL file declares {declared} triangles, but has only {len(data) - 84} bytes for them."
        )
    return 3 * faces, faces


def stl_facets(data: Data) -> tuple[int, int]:
    """Return how many facets a binary STL declares, and how many it has: programs that stream do not know before.

    More than are declared count if they fill the file, and if the next one has numbers as its neighbours have.
    """
    declared, (held, rest) = int.from_bytes(bytes(data[80:84]), "little"), divmod(len(data) - 84, 50)
    if rest or held <= declared:
        return declared, declared
    corners = struct.unpack("<9f", bytes(data[96 + 50 * declared : 132 + 50 * declared]))
    size = max(map(abs, corners))
    likely = all(math.isfinite(value) for value in corners) and _LEAST_SIZE < size < _MOST_SIZE
    return declared, held if likely else declared
