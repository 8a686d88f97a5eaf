"""Move other surfaces by the deformation of one: levels of detail, collision meshes, clothes, props.

A map is a simplified mesh at rest, of as few triangles as represent the deformation, and the displacement of each of
its vertices. Other surfaces follow their nearest points on it by affine maps (`binding.py`), so that every similarity
is exact. It also has the moves of the joints: files with the same skeleton move it alike, whatever their own vertices
do.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from meshdeform.deformation.binding import Binding
from meshdeform.errors import ParameterError
from meshdeform.geometry.congruence import closest_motion
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.shapes import simplified

_FORMAT = "meshdeform-edit-map"
_VERSION = "1"
_COUNTS = (250, 500, 1000, 2000, 4000, 8000)
_ERROR = 0.01
"""Distance from its true position, as a share of the diagonal, within which a map must take 99 % of the surface."""
_MARGIN = 0.1
"""How far the box reaches beyond the mesh, as a share of the diagonal."""
_ALIKE = 1e-3
"""Distance between two joints of one name, as a share of the diagonal, up to which they are the same."""

_Floats = NDArray[np.float64]


class Outside(StrEnum):
    """Treatment of a connected piece that reaches out of the map's box."""

    REFUSE = "refuse"
    RIGID = "rigid"


@dataclass(frozen=True)
class EditMap:
    """The deformation of a surface, for other surfaces."""

    rest: RestMesh  # in world space
    moved: _Floats  # (V, 3) float64: displacements of its vertices
    joints: Mapping[str, _Floats] | None = field(default=None, compare=False)
    """mapping of str to (7,) float64: by the name of each joint its position, its displacement, and the growth of the
    volume around it; None if the rig stayed as it was."""
    error: float = 0.0
    """Distance from where they should be within which 99 % of the surface's own vertices are taken, as a share of the
    diagonal."""

    @classmethod
    def between(cls, before: RestMesh, after: _Floats, joints: Mapping[str, _Floats] | None = None) -> EditMap:
        """Return the map of a surface's deformation to vertices (V, 3) float64: the smallest that is exact enough."""
        whole = cls(before, after - before.verts, joints)
        for count in _COUNTS:
            if count >= len(before.faces):
                break
            simple = RestMesh.of(simplified(before, count))
            if not len(simple.faces) or len(simple.faces) == len(before.faces):
                break
            edit = cls(simple, whole._moved_verts(simple) - simple.verts, joints)
            apart = np.linalg.norm(edit._moved_verts(before) - after, axis=1)
            error = float(np.percentile(apart, 99)) / _diagonal(before)
            if error <= _ERROR:
                return cls(simple, edit.moved, joints, error)
        return whole

    def move(self, mesh: TriangleMesh, outside: Outside = Outside.REFUSE) -> _Floats:
        """Return the vertices (N, 3) float64 of another mesh, moved.

        Raises
        ------
        ParameterError
            The mesh lies elsewhere, or some of it outside of the box although that is to be refused.
        """
        rest = RestMesh.of(mesh)
        margin = _MARGIN * _diagonal(self.rest)
        low, high = self.rest.box[0] - margin, self.rest.box[1] + margin
        points, used = rest.verts, np.unique(rest.faces)
        beyond: NDArray[np.bool_] = np.any((points < low) | (points > high), axis=1)
        pieces = rest.components
        if beyond[used].all():
            raise ParameterError(
                f"The file lies {_between(*rest.box)}, all outside of what the map deforms: {_between(low, high)}.",
                advice="Both files need the same origin, axes and units.",
            )
        reaching = np.unique(pieces[used][beyond[used]])
        if len(reaching) and outside is Outside.REFUSE:
            count = len(np.unique(pieces[used]))
            raise ParameterError(
                f"{len(reaching)} of {count} pieces reach out of what the map deforms: {_between(low, high)}.",
                advice="Have such pieces carried along in their shape: --outside rigid, or ?outside=rigid.",
            )
        moved = self._moved_verts(rest)
        for piece in reaching:
            rows = np.flatnonzero(pieces == piece)
            moved[rows] = self._moved_rigidly(points[rows])
        return rest.junctions.closed(points, moved)

    def _moved_verts(self, mesh: RestMesh) -> _Floats:
        return Binding(self.rest, mesh, closely=True).move(self.rest.verts + self.moved)

    def _moved_rigidly(self, points: _Floats) -> _Floats:
        """Return points that move as the mesh does nearest to them, without a change of their distances."""
        nearest_points = NearestPoints(self.rest, points, np.zeros_like(points))
        nearest = int(nearest_points.distances(points).argmin())
        around = self.rest.verts - nearest_points.blend(self.rest.verts)[nearest]
        near = np.argsort((around**2).sum(1))[: max(12, len(around) // 50)]
        before = self.rest.verts[near]
        motion = closest_motion(before, before + self.moved[near])
        return np.asarray(points @ motion.rotation.T + motion.shift)

    def same_joint(self, name: str, position: _Floats) -> _Floats | None:
        """Return the displacement and growth (4,) of the joint of this name and position, if the map has it."""
        row = (self.joints or {}).get(name)
        if row is None or float(np.linalg.norm(row[:3] - position)) > _ALIKE * _diagonal(self.rest):
            return None
        return row[3:]

    def to_bytes(self) -> bytes:
        """Return the map as a safetensors file."""
        joints = self.joints
        tensors = {
            "rest": self.rest.verts.astype(np.float32),
            "moved": self.moved.astype(np.float32),
            "faces": self.rest.faces.astype(np.uint16 if len(self.rest.verts) < 2**16 else np.uint32),
        }
        if joints is not None:
            tensors["joints"] = np.array(list(joints.values()), np.float32).reshape(-1, 7)
        about = {"format": _FORMAT, "version": _VERSION, "error": f"{self.error:.3g}"}
        return save(tensors, about | {"joints": json.dumps(list(joints or {}))})

    @classmethod
    def read(cls, path: str) -> EditMap:
        """Read a file that `to_bytes` made.

        Raises
        ------
        ParameterError
            It is none, is damaged, or of a later version.
        """
        try:
            with safe_open(path, framework="np") as file:
                about = file.metadata() or {}
                if about.get("format") != _FORMAT or about.get("version") != _VERSION:
                    raise ParameterError(
                        "The file is not a map of this version of Meshdeform.",
                        advice="Make it again: meshdeform apply RESULT.glb -o edit.safetensors.",
                    )
                rest, moved, faces = (file.get_tensor(name) for name in ("rest", "moved", "faces"))
                names = json.loads(about["joints"])
                rows = file.get_tensor("joints").astype(np.float64) if "joints" in file.keys() else None  # noqa: SIM118
            return cls._checked(rest, moved, faces, rows, names, float(about["error"]))
        except (SafetensorError, KeyError, ValueError, TypeError) as error:
            raise ParameterError("The map is damaged.", advice="Make or download it again.") from error

    @classmethod
    def _checked(
        cls,
        rest: NDArray[np.float32],
        moved: NDArray[np.float32],
        faces: NDArray[np.uint16],
        rows: _Floats | None,
        names: list[str],
        error: float,
    ) -> EditMap:
        shaped = rest.ndim == 2 and rest.shape[1:] == (3,) == faces.shape[1:] and moved.shape == rest.shape
        if not shaped or not len(faces) or int(faces.max()) >= len(rest):
            raise ValueError("shapes")
        if rows is not None and rows.shape != (len(names), 7):
            raise ValueError("joints")
        if not all(np.isfinite(values).all() for values in (rest, moved, np.zeros(0) if rows is None else rows)):
            raise ValueError("not finite")
        mesh = RestMesh(rest.astype(np.float64), faces.astype(np.int64))
        joints = None if rows is None else dict(zip(names, rows, strict=True))
        return cls(mesh, moved.astype(np.float64), joints, error)


def _diagonal(mesh: RestMesh) -> float:
    low, high = mesh.box
    return float(np.linalg.norm(high - low))


def _between(low: _Floats, high: _Floats) -> str:
    corners = ("(" + ", ".join(f"{value:.3g}" for value in corner) + ")" for corner in (low, high))
    return "from {} to {}".format(*corners)
