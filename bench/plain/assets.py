"""Read the list of assets and sentences, find the files by their hash, and make those that are made."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.assets import Asset, build_glb, load_asset
from meshdeform.assets.build import Primitive
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from training.shapes import box, lathe

__all__ = ["Listed", "Row", "Wanted", "connected", "listed", "rows"]

HERE = Path(__file__).parent
_MOSTLY = 0.5
_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Wanted:
    """What a sentence should make of a part: `factor` times as large along a direction; free if there is none."""

    part: str
    direction: str = ""
    factor: float = 1.0


@dataclass(frozen=True)
class Row:
    """A line of `sentences.txt`."""

    asset: str
    sentence: str
    expected: bool  # whether an artist would expect it to work
    wanted: tuple[Wanted, ...]  # empty if it should be refused


@dataclass(frozen=True)
class Listed:
    """An asset of `assets.toml`, with its file."""

    name: str
    data: bytes
    filename: str
    front: str  # as `+Z`
    selectors: Mapping[str, Sequence[str]]

    def asset(self) -> Asset:
        """Return the asset, read from its file."""
        return load_asset(self.data, self.filename)

    def pieces(self, asset: Asset, part: str, least: float = _MOSTLY) -> list[_Flags]:
        """Return the vertices (N,) of each piece of a part of the asset, read from this file.

        `least`: how much of a vertex the joints of the part hold, if joints make it.
        """
        found = []
        for selector in self.selectors[part]:
            flags = _chosen(asset, selector.removeprefix("each "), least)
            found += _apart(asset, flags) if selector.startswith("each ") else [flags]
        return found


def rows() -> list[Row]:
    """Return the lines of `sentences.txt`."""
    found = []
    for line in (HERE / "sentences.txt").read_text().splitlines():
        if line.startswith("#") or "|" not in line:
            continue
        asset, sentence, expected, wanted = (each.strip() for each in line.split("|"))
        clauses = [] if wanted == "refuse" else [_wanted(clause.strip()) for clause in wanted.split(";")]
        found.append(Row(asset, sentence, expected == "yes", tuple(clauses)))
    return found


def _wanted(clause: str) -> Wanted:
    if clause.endswith(" free"):
        return Wanted(clause.removesuffix(" free"))
    part, direction, factor = clause.rsplit(" ", 2)
    return Wanted(part, direction, float(factor))


def listed(folder: Path) -> list[Listed]:
    """Return the assets whose files are anywhere in a folder, by their hash, and those that are made."""
    files = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in folder.rglob("*") if path.is_file()}
    found = []
    for name, entry in tomllib.loads((HERE / "assets.toml").read_text()).items():
        if "made" in entry:
            data, filename = _MADE[entry["made"]]()
        elif entry["sha256"] in files:
            data, filename = files[entry["sha256"]].read_bytes(), files[entry["sha256"]].name
        else:
            continue
        found.append(Listed(name, data, filename, entry["front"], entry["parts"]))
    return found


def _chosen(asset: Asset, selector: str, least: float) -> _Flags:
    """Return the vertices (N,) that a selector of `assets.toml` names."""
    first, *others = (each.strip() for each in selector.split("&"))
    if others:
        return np.asarray(np.logical_and.reduce([_chosen(asset, each, least) for each in (first, *others)]))
    kind, _, what = selector.partition(":")
    points, parts = asset.surface.positions, asset.pieces()
    flags = np.zeros(len(points), bool)
    if kind == "box":
        low, high = np.array([float(value) for value in what.split()]).reshape(3, 2).T
        shares = (points - points.min(0)) / np.ptp(points, axis=0)
        return np.asarray(((shares >= low - 1e-6) & (shares <= high + 1e-6)).all(1))
    if kind == "joint":
        at, nodes, shares = asset.joint_shares()
        own = [joint["index"] for joint in parts.joints if re.fullmatch(what, joint["name"])]
        held = np.zeros(len(points))
        np.add.at(held, at, np.isin(nodes, own) * shares)
        return held > least
    entries, triangles_of = (parts.nodes, parts.in_node) if kind == "node" else (parts.materials, parts.of_material)
    for entry in entries:
        if re.fullmatch(what, entry["name"]):
            flags[asset.surface.triangles[triangles_of(entry["index"])].ravel()] = True
    return flags


def connected(asset: Asset, flags: _Flags) -> list[_Flags]:
    """Return the connected components (N,) of some vertices; those at one place count as one."""
    points, triangles = asset.surface.positions, asset.surface.triangles
    places, number = np.unique(points.round(6), axis=0, return_inverse=True)
    number = number.ravel()
    own = number[triangles[flags[triangles].all(1)]]
    edges = np.concatenate([own[:, [0, 1]], own[:, [1, 2]]])
    graph = sparse.coo_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(len(places),) * 2)
    labels = csgraph.connected_components(graph, directed=False)[1][number]
    return [flags & (labels == label) for label in np.unique(labels[flags])]


def _apart(asset: Asset, flags: _Flags) -> list[_Flags]:
    """Return the connected components (N,) of some vertices; one within the box of another belongs to it."""
    points = asset.surface.positions
    boxes: list[tuple[_Floats, _Floats, _Flags]] = []
    for piece in sorted(connected(asset, flags), key=lambda piece: -float(np.ptp(points[piece], axis=0).max())):
        low, high = points[piece].min(0), points[piece].max(0)
        home = next((box for box in boxes if (low >= box[0] - 1e-6).all() and (high <= box[1] + 1e-6).all()), None)
        if home is not None:
            home[2][piece] = True
        else:
            boxes.append((low, high, piece.copy()))
    return [piece for _, _, piece in boxes]


def _block(low: Sequence[float], high: Sequence[float], n: int = 4) -> TriangleMesh:
    """Return a box between two corners, of n x n squares a side."""
    mesh = box(n, (high[0] - low[0], high[1] - low[1], high[2] - low[2]))
    middle = (mesh.verts.min(0) + mesh.verts.max(0)) / 2
    return TriangleMesh(mesh.verts - middle + np.array([low, high]).mean(0), mesh.faces)


def _bottle() -> tuple[bytes, str]:
    """Return a round bottle of a metre with its cork, and a ring of slivers about its belly."""
    outline = [(0.0, 0.0), (0.2, 0.0), (0.22, 0.02), (0.31, 0.15), (0.33, 0.3), (0.33, 0.3005), (0.31, 0.45)]
    outline += [(0.22, 0.58), (0.1, 0.68), (0.08, 0.72), (0.08, 0.78), (0.08, 0.84), (0.09, 0.9), (0.06, 0.9)]
    outline += [(0.06, 0.7), (0.0, 0.7)]
    glass = lathe(outline, 48)
    cork = lathe([(0.0, 0.86), (0.06, 0.86), (0.06, 0.93), (0.06, 1.0), (0.0, 1.0)], 24)
    made = [("Glass", glass), ("Cork", cork)]
    return build_glb([Primitive(mesh.verts, mesh.faces, name=name) for name, mesh in made]), "a.glb"


def _chair() -> tuple[bytes, str]:
    """Return a chair of boxes that looks along +Z, as an OBJ."""
    legs = [_block((x, 0, z), (x + 0.05, 0.42, z + 0.05)) for x in (-0.25, 0.2) for z in (-0.25, 0.2)]
    seat, back = (
        _block((-0.25, 0.42, -0.25), (0.25, 0.48, 0.25), 8),
        _block((-0.25, 0.48, -0.25), (0.25, 0.98, -0.2), 8),
    )
    mesh = join(seat, back, *legs)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.verts.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    return "\n".join(lines).encode(), "a.obj"


_MADE: dict[str, Any] = {"bottle": _bottle, "chair": _chair}
