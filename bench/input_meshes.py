"""Generate the meshes of `bench.inputs`: difficult input for deformation and mesh processing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry.mesh import TriangleMesh, safe_normalize
from meshdeform.geometry.shapes import icosphere, join
from training.evaluation.relaxed import geodesic_sphere
from training.shapes import box, cylinder, grid, lathe, torus, uv_sphere

__all__ = ["BAD", "INPUTS", "Input"]

_Floats = NDArray[np.float64]
_Faces = NDArray[np.int64]


@dataclass(frozen=True)
class Input:
    """A mesh, what is difficult about it, and the translation of its node.

    `meets`: its components cut or touch each other at rest, so that only cuts within a component count. `file`: the way
    to pack it, by its name in `bench.input_files.FILES`.
    """

    special: str
    verts: _Floats
    faces: _Faces
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    meets: bool = False
    file: str = "plain"


def _of(special: str, mesh: TriangleMesh, *, meets: bool = False) -> Input:
    return Input(special, mesh.verts, mesh.faces, meets=meets)


def _moved(mesh: TriangleMesh, x: float = 0.0, y: float = 0.0, z: float = 0.0, scale: float = 1.0) -> TriangleMesh:
    return TriangleMesh(mesh.verts * scale + np.array([x, y, z], np.float64), mesh.faces)


def _sphere(size: float) -> TriangleMesh:
    """Return a sphere of even triangles, 2,000 at size 1."""
    return geodesic_sphere(max(2, round(10 * size)))


def _count(size: float, count: int) -> int:
    return max(3, round(count * size))


def _book(size: float) -> Input:
    page = grid(_count(size, 18), 1.0)
    pages = []
    for k in range(3):
        turn = 2 * math.pi * k / 3
        x = page.verts[:, 0] + 0.5
        pages.append(TriangleMesh(np.stack([x * math.cos(turn), page.verts[:, 1], x * math.sin(turn)], 1), page.faces))
    return _of("three sheets that share a line: edges of three faces", join(*pages))


def _walled(size: float) -> Input:
    n = _count(size, 10)
    halves = [_moved(box(n), x=-0.5), _moved(box(n), x=0.5)]
    return _of("two boxes with a common wall: edges of four faces, the wall's faces twice", join(*halves))


def _bow_tie(size: float) -> Input:
    ball = _sphere(0.7 * size)
    top = float(ball.verts[:, 1].max())
    bottom = float(ball.verts[:, 1].min())
    return _of("two spheres that share one vertex", join(ball, _moved(ball, y=top - bottom)))


def _holed(size: float) -> Input:
    ball = _sphere(size)
    return _of("a sphere with a hole", TriangleMesh(ball.verts, ball.faces[ball.verts[ball.faces].mean(1)[:, 1] < 0.6]))


def _unreferenced(size: float) -> Input:
    ball = _sphere(size)
    strays = 50 * np.random.default_rng(0).normal(size=(500, 3))
    order = np.random.default_rng(1).permutation(500 + len(ball.verts))
    verts = np.empty((len(order), 3))
    verts[order] = np.concatenate([ball.verts, strays])
    return _of("500 vertices that no face uses, far away", TriangleMesh(verts, order[ball.faces]))


def _charts(size: float) -> Input:
    ball = _sphere(size)
    middle = ball.verts[ball.faces].mean(1)
    axis = np.abs(middle).argmax(1)
    chart = 2 * axis + (np.take_along_axis(middle, axis[:, None], 1)[:, 0] > 0)
    corners = ball.faces * 6 + chart[:, None]
    kept, inverse = np.unique(corners, return_inverse=True)
    faces = inverse.reshape(-1, 3)
    return _of("vertices doubled at the seams of six UV charts", TriangleMesh(ball.verts[kept // 6], faces))


def _soup(size: float) -> Input:
    ball = _sphere(size)
    faces = np.arange(3 * len(ball.faces)).reshape(-1, 3)
    return _of("three separate vertices for every face", TriangleMesh(ball.verts[ball.faces].reshape(-1, 3), faces))


def _repeated(size: float) -> Input:
    ball = _sphere(size)
    return _of("every fifth face twice", TriangleMesh(ball.verts, np.concatenate([ball.faces, ball.faces[::5]])))


def _double_sided(size: float) -> Input:
    ball = _sphere(0.7 * size)
    return _of("every face and its back", TriangleMesh(ball.verts, np.concatenate([ball.faces, ball.faces[:, ::-1]])))


def _zero_area(size: float) -> Input:
    """Return a sphere with collinear faces, which fill gaps at split edges, and faces of one or two vertices."""
    ball = _sphere(size)
    verts, faces = ball.verts.astype(np.float32).astype(np.float64), ball.faces
    a, b, c = faces[::6].T
    middle = len(verts) + np.arange(len(a))
    split = [np.stack([a, middle, c], 1), np.stack([middle, b, c], 1), np.stack([a, b, middle], 1)]
    kept = np.ones(len(faces), bool)
    kept[::6] = False
    points = np.stack([a[:20], a[:20], b[:20]], 1), np.stack([c[:20]] * 3, 1)
    mesh = TriangleMesh(
        np.concatenate([verts, (verts[a] + verts[b]) / 2]), np.concatenate([faces[kept], *split, *points])
    )
    return _of("every sixth face next to a collinear face; faces of one and two vertices", mesh)


def _needles(size: float) -> Input:
    """Return a sphere with narrow bands of triangles that are 10,000 times as long as wide."""
    n, rings = _count(size, 36), _count(size, 10)
    narrow = 2 * math.pi / n * 1e-4
    profile = [(0.0, -1.0)]
    for i in range(1, rings):
        polar = math.pi * i / rings
        radius = math.sin(polar)
        profile += [(math.sin(p), -math.cos(p)) for p in (polar, polar + radius * narrow)]
    return _of("bands of triangles 10,000 times as long as wide", lathe([*profile, (0.0, 1.0)], n))


def _winding(size: float) -> Input:
    ball = _sphere(size)
    turned = np.random.default_rng(0).random((len(ball.faces), 1)) < 0.3
    faces = np.where(turned, ball.faces[:, ::-1], ball.faces)
    return _of("three in ten faces wound inside out", TriangleMesh(ball.verts, faces))


def _pinched(size: float) -> Input:
    ball = _sphere(size)
    verts = ball.verts.copy()
    verts[verts[:, 1].argmax()] = verts[verts[:, 1].argmin()]
    return _of("a spike whose tip is at the position of another vertex", TriangleMesh(verts, ball.faces))


def _moebius(size: float, across: int, special: str) -> Input:
    n = _count(size, 96)
    around, wide = np.meshgrid(np.arange(n), np.arange(across + 1), indexing="ij")
    turn = around / n * 2 * math.pi
    out = (wide / across - 0.5) * 0.6
    radius = 1 + out * np.cos(turn / 2)
    verts = np.stack([radius * np.sin(turn), out * np.sin(turn / 2), radius * np.cos(turn)], -1).reshape(-1, 3)
    i, j = (each.reshape(-1) for each in np.meshgrid(np.arange(n), np.arange(across), indexing="ij"))
    # The last column joins the first one upside down.
    last = i == n - 1
    a, b = i * (across + 1) + j, i * (across + 1) + j + 1
    c = np.where(last, across - j - 1, (i + 1) * (across + 1) + j + 1)
    d = np.where(last, across - j, (i + 1) * (across + 1) + j)
    return _of(special, TriangleMesh(verts, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])))


def _genus_two(size: float) -> Input:
    """Return a slab of 5 x 3 x 1 finely divided blocks, two of them removed."""
    k = _count(size, 5)
    solid = np.ones((5, 3, 1), bool)
    solid[1, 1], solid[3, 1] = False, False
    solid = np.pad(np.kron(solid, np.ones((k, k, k), bool)), 1)
    quads = []
    for axis in range(3):
        for side in (0, 1):
            bare = solid & ~np.roll(solid, 1 - 2 * side, axis)
            corner = np.argwhere(bare)
            corner[:, axis] += side
            u, v = np.eye(3, dtype=np.int64)[[(axis + 1) % 3, (axis + 2) % 3]]
            around = np.stack([corner, corner + u, corner + u + v, corner + v], 1)
            quads.append(around if side else around[:, ::-1])
    corners = np.concatenate(quads)
    points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 4)
    faces = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])
    return Input("two through-holes, right angles", points / k - points.max(0) / (2 * k), faces)


def _parts(size: float) -> Input:
    ball = _sphere(0.58 * size)
    return _of("three spheres apart", join(ball, _moved(ball, x=3.0), _moved(ball, y=2.5, scale=0.5)))


def _nested(size: float) -> Input:
    ball = _sphere(0.58 * size)
    return _of("three spheres, one within the other", join(ball, _moved(ball, scale=0.7), _moved(ball, scale=0.3)))


def _touching(size: float) -> Input:
    n = _count(size, 10)
    stood = join(_moved(box(n), y=0.5), _moved(box(max(2, n - 3)), y=-0.75, scale=1.5))
    return _of("a box that stands on another, without common vertices", stood, meets=True)


def _overlapping(size: float) -> Input:
    ball = _sphere(0.7 * size)
    pair = join(ball, _moved(ball, x=0.9, y=0.3, scale=0.8))
    return _of("two spheres that cut each other at rest", pair, meets=True)


def _cubes(size: float) -> Input:
    side = _count(size, 6)
    boxes = [_moved(box(1), x=i, y=j, z=k, scale=0.5) for i in range(side) for j in range(side) for k in range(side)]
    return _of("216 boxes of 12 faces apart", join(*boxes))


def _confetti(size: float) -> Input:
    random = np.random.default_rng(1)
    count = _count(size, 400)
    centres = safe_normalize(random.normal(size=(count, 1, 3)))
    corners = (centres + 0.05 * random.normal(size=(count, 3, 3))).reshape(-1, 3)
    mesh = TriangleMesh(corners, np.arange(3 * count).reshape(-1, 3))
    return _of("400 single triangles, some through others", mesh)


def _speck(size: float) -> Input:
    speck = _moved(icosphere(1), x=1.5, scale=1e-4)
    return _of("a sphere next to one of a ten-thousandth of its size", join(_sphere(size), speck))


def _far(size: float) -> Input:
    return _of("radius 1,000 around (1e6, 1e6, 1e6) in 32-bit floats", _moved(_sphere(size), 1e6, 1e6, 1e6, 1000.0))


def _far_node(size: float) -> Input:
    ball = _sphere(size)
    return Input("radius 1 on a node at (1e6, 1e6, 1e6)", ball.verts, ball.faces, (1e6, 1e6, 1e6))


def _coarse(size: float) -> Input:
    ball = _moved(_sphere(size), 1e6, 1e6, 1e6, 4.0)
    return _of("radius 4 around (1e6, 1e6, 1e6), where 32-bit floats step by 1/16", ball)


def _triangle(_: float) -> Input:
    return Input("one face", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def _large(size: float) -> Input:
    return _of("100,000 triangles", torus(0.7, 0.25, _count(size, 500), _count(size, 100)))


def _packed(file: str, special: str) -> Callable[[float], Input]:
    def made(size: float) -> Input:
        ball = _sphere(size)
        return Input(special, ball.verts, ball.faces, file=file)

    return made


_PACKED = {
    "draco-skin": "Draco, with skin weights that it rounds",
    "instanced": "drawn 50 times by EXT_mesh_gpu_instancing",
    "broken-normals": "normals and tangents of which some are NaN or zero",
    "loose": "points and lines in the same mesh",
    "backdrop": "over a ground plane of ten times its width",
    "image-outside": "a GLB whose image is in another file",
    "data-uris": "glTF JSON with a buffer and an image as data URIs",
    "gltf-zip": "a ZIP of a .gltf, its buffer and its image",
    "obj-zip": "a ZIP of an OBJ of two materials, its MTL and a texture",
}


def _tubes(size: float, special: str, change: Callable[[TriangleMesh], TriangleMesh]) -> Input:
    """Return an upright bottle with something done to it."""
    heights = np.linspace(0.0, 1.0, _count(size, 25))
    radii = np.interp(heights, [0.0, 0.3, 0.6, 0.7, 1.0], [0.3, 0.35, 0.3, 0.12, 0.12])
    outline = [(0.0, 0.0), *zip(radii.tolist(), heights.tolist(), strict=True), (0.0, 1.0)]
    bottle = lathe(outline, _count(size, 32))
    return _of(special, change(bottle), meets=True)


def _added(mesh: TriangleMesh, verts: Any, faces: Any) -> TriangleMesh:
    """Return a mesh with more vertices, and faces whose negative corners are among these."""
    more, own = np.asarray(verts, float).reshape(-1, 3), np.asarray(faces)
    own = np.where(own < 0, len(mesh.verts) - 1 - own, own)
    return TriangleMesh(np.concatenate([mesh.verts, more]), np.concatenate([mesh.faces, own]))


def _middles(mesh: TriangleMesh, count: int) -> tuple[_Floats, _Faces]:
    """Return the middles of the first edges of some faces, and these faces split there, as their neighbours are not."""
    chosen = np.linspace(0, len(mesh.faces) - 1, count).astype(int)
    a, b, c = mesh.faces[chosen].T
    new = -1 - np.arange(count)
    return (mesh.verts[a] + mesh.verts[b]) / 2, np.concatenate([np.stack([a, new, c], 1), np.stack([new, b, c], 1)])


def _t_junctions(mesh: TriangleMesh) -> TriangleMesh:
    verts, faces = _middles(mesh, 12)
    chosen = np.linspace(0, len(mesh.faces) - 1, 12).astype(int)
    return _added(TriangleMesh(mesh.verts, np.delete(mesh.faces, chosen, 0)), verts, faces)


def _fins(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh with a third face at some edges."""
    a, b, _ = mesh.faces[:: max(1, len(mesh.faces) // 12)].T
    tips = (mesh.verts[a] + mesh.verts[b]) / 2 * [1.4, 1.0, 1.4]
    return _added(mesh, tips, np.stack([a, b, -1 - np.arange(len(a))], 1))


def _islands(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh with triangles of their own near it."""
    corners = mesh.verts[mesh.faces[:: max(1, len(mesh.faces) // 20)]] * [1.2, 1.0, 1.2]
    return _added(mesh, corners, -1 - np.arange(3 * len(corners)).reshape(-1, 3))


def _shared_corner(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh whose vertex is the tip of a cone as well."""
    tip = mesh.verts[len(mesh.verts) // 2]
    ring = tip + 0.1 * np.array([[1, 1, 0], [1, 0, 1], [1, -1, 0], [1, 0, -1]])
    at = len(mesh.verts) // 2
    return _added(mesh, ring, [[at, -1, -2], [at, -2, -3], [at, -3, -4], [at, -4, -1]])


def _without(mesh: TriangleMesh, share: float) -> TriangleMesh:
    kept = np.random.default_rng(3).random(len(mesh.faces)) >= share
    return TriangleMesh(mesh.verts, mesh.faces[kept])


def _narrow(mesh: TriangleMesh, width: float) -> TriangleMesh:
    """Return a mesh with a needle of that width beside the first edge of some faces, which closes it again."""
    chosen = np.arange(0, len(mesh.faces), max(1, len(mesh.faces) // 16))
    a, b, c = mesh.faces[chosen].T
    inner = (1 - width) * (mesh.verts[a] + mesh.verts[b]) / 2 + width * mesh.verts[c]
    new = -1 - np.arange(len(chosen))
    parts = [np.stack(corners, 1) for corners in ((a, b, new), (b, c, new), (c, a, new))]
    return _added(TriangleMesh(mesh.verts, np.delete(mesh.faces, chosen, 0)), inner, np.concatenate(parts))


_BAD: dict[str, tuple[str, Callable[[TriangleMesh], TriangleMesh]]] = {
    "needles-thin": ("needles a thousandth as wide as long", lambda mesh: _narrow(mesh, 1e-3)),
    "needles-hair": ("needles a millionth as wide as long", lambda mesh: _narrow(mesh, 1e-6)),
    "needles-flat": ("faces without area inside others", lambda mesh: _narrow(mesh, 0.0)),
    "t-junctions": ("vertices in the middle of edges of others", _t_junctions),
    "fins": ("a third face at some edges", _fins),
    "fans": ("five faces at some edges", lambda mesh: _fins(_fins(_fins(mesh)))),
    "islands": ("triangles of their own beside it", _islands),
    "shared-corner": ("a cone and the surface share a vertex", _shared_corner),
    "duplicates": ("every face twice", lambda mesh: TriangleMesh(mesh.verts, np.tile(mesh.faces, (2, 1)))),
    "some-duplicates": (
        "every tenth face three times",
        lambda mesh: TriangleMesh(mesh.verts, np.concatenate([mesh.faces, mesh.faces[::10], mesh.faces[::10]])),
    ),
    "opposites": (
        "every face from both sides",
        lambda mesh: TriangleMesh(mesh.verts, np.concatenate([mesh.faces, mesh.faces[:, ::-1]])),
    ),
    "some-opposites": (
        "every tenth face from both sides",
        lambda mesh: TriangleMesh(mesh.verts, np.concatenate([mesh.faces, mesh.faces[::10, ::-1]])),
    ),
    "inside-out": ("wound inside out", lambda mesh: TriangleMesh(mesh.verts, mesh.faces[:, ::-1])),
    "gaps": ("a tenth of the faces missing", lambda mesh: _without(mesh, 0.1)),
    "rags": ("half of the faces missing", lambda mesh: _without(mesh, 0.5)),
    "unwelded": (
        "no two faces share a vertex",
        lambda mesh: TriangleMesh(mesh.verts[mesh.faces].reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3)),
    ),
}

INPUTS: dict[str, Callable[[float], Input]] = {
    "sphere": lambda size: _of("plain: the reference of the ratios", _sphere(size)),
    "parts": _parts,
    "nested": _nested,
    "touching": _touching,
    "overlapping": _overlapping,
    "cubes": _cubes,
    "confetti": _confetti,
    "book": _book,
    "walled": _walled,
    "bow-tie": _bow_tie,
    "sheet": lambda size: _of("open, flat", grid(_count(size, 32))),
    "tube": lambda size: _of("open at both ends", cylinder(n=_count(size, 40), rings=_count(size, 25), capped=False)),
    "holed": _holed,
    "unreferenced": _unreferenced,
    "charts": _charts,
    "soup": _soup,
    "repeated": _repeated,
    "double-sided": _double_sided,
    "zero-area": _zero_area,
    "poles": lambda size: _of("fans of 250 needles at two poles", uv_sphere(_count(size, 5), _count(size, 250))),
    "needles": _needles,
    "winding": _winding,
    "triangle": _triangle,
    "pinched": _pinched,
    "speck": _speck,
    "far": _far,
    "far-node": _far_node,
    "coarse": _coarse,
    "tiny": lambda size: _of("radius 1e-6", _moved(_sphere(size), scale=1e-6)),
    "moebius": lambda size: _moebius(size, 10, "one-sided: no winding is consistent"),
    "moebius-narrow": lambda size: _moebius(size, 1, "one-sided, one row of faces: every vertex on the border"),
    "genus-1": lambda size: _of("a through-hole", torus(0.7, 0.25, _count(size, 45), _count(size, 22))),
    "genus-2": _genus_two,
    **{name: _packed(name, special) for name, special in _PACKED.items()},
    "large": _large,
}
"""Every input by name, as a function of its size: 1 in the benchmark, less for a coarser mesh of the same kind."""

BAD: dict[str, Callable[[float], Input]] = {
    **{
        name: made
        for name, made in INPUTS.items()
        if name not in _PACKED and name not in ("sphere", "large", "far-node")
    },
    **{name: partial(_tubes, special=special, change=change) for name, (special, change) in _BAD.items()},
}
"""What modelling, scanning and conversion leave behind: those of `INPUTS`, and bottles, for `bench.bad_meshes`."""
