"""Lay the controls of a request over where a fit takes a surface, which knows none of them.

Handles are pulled to their goals by a map of space. With v the vertices, p_h the points of the handles among them, s
the share of their displacement that vertices near what is kept have (`deformation.constraints`), and Wendland's
function of radius R::

    v <- v + s(v) sum_h c_h phi(|v - p_h| / R),     phi(r) = (1 - r)^4 (4 r + 1) for r < 1, else 0

where the c_h take each handle of weight 1 to its goal, and a softer one its share of the way. R is a quarter of the
diagonal, or 2.5 times the longest way if that is more: below 2.1 times, the map would fold. What is kept, what is
mirrored and the vertices on edges of other faces are then placed as under an optimiser. Last, rigid parts take the
motion nearest to where their vertices are, and what is within the fall-off of one moves along.

What that breaks is mended; mending knows no controls either, so they are laid over its result once more, and where
something is broken still, the surface goes back toward its shape at rest.

Source: Wendland 1995, Piecewise polynomial, positive definite and compactly supported radial functions.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from meshdeform.deformation.constraints import handle_rows
from meshdeform.exemplar.faults import Faults
from meshdeform.exemplar.mending import Mended, mended
from meshdeform.geometry.congruence import closest_motion
from meshdeform.geometry.mesh import RestMesh
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests.choices import Rigidity
from meshdeform.runs.control import AssetControl

__all__ = ["FitControls"]

_Floats = NDArray[np.float64]
_REACH, _LONGEST = 0.25, 2.5
"""Radius of a handle's map, as a share of the diagonal, and in lengths of its way, at least."""
_ROUNDS, _THERE = 40, 1e-9
"""How often handles are pulled, as a mirror takes half of each pull; the distance, as a share, that counts as none."""
_BACK, _AROUND, _GROWTH, _TRIES = 0.8, 0.01, 1.3, 40
"""Share of its way that a faulty place keeps each time, within which distance, and by what that grows."""


class FitControls:
    """The controls of a request over the vertices (V, 3) of one welded mesh, in the file's units."""

    def __init__(self, control: AssetControl, frame: CameraFrame, mesh: RestMesh) -> None:
        self._control, self._frame, self._mesh = control, frame, mesh
        self._rest, self._faces = mesh.verts, mesh.faces
        self._diagonal = float(np.linalg.norm(np.ptp(self._rest, axis=0)))
        freedom = control.constraints.freedom
        self._share = np.ones(len(self._rest)) if freedom is None else freedom**2 * (3 - 2 * freedom)
        self._placement = control.constraints.placement(mesh)

    def laid_over(self, verts: _Floats) -> _Floats:
        """Return vertices (V, 3) as the controls have them; what is kept has the bits of the mesh at rest."""
        return self._rigid(self._pulled(verts, self._goals(self._placed(verts))))

    def mended(self, verts: _Floats) -> Mended:
        """Return vertices (V, 3), over which the controls were laid, with what that broke mended within them."""
        done = mended(self._rest, verts, self._faces)
        within = self._rigid(self._pulled(done.verts, self._handled @ verts))
        faults = Faults(self._rest, self._faces)
        kept = np.ones(len(verts))
        for number in range(_TRIES):
            tried = self._rigid(self._rest + kept[:, None] * (within - self._rest))
            found = faults.find(tried)
            if found.is_clean:
                break
            kept = kept * self._taken_back(np.unique(self._faces[found.to_mend]), number)
        whole = float(np.linalg.norm(verts - self._rest, axis=1).sum())
        lost = float(np.linalg.norm(verts - tried, axis=1).sum())
        left = 1 - lost / whole if whole > 0 else 1.0
        return replace(done, verts=tried, kept=left, flipped=int(found.folded.sum()), cut=int(found.cutting.sum()))

    def _placed(self, verts: _Floats) -> _Floats:
        return verts if self._placement is None else self._placement.place(verts)

    @cached_property
    def _handled(self) -> sparse.csr_matrix:
        """The matrix (H, V) that takes the points of the handles from the vertices."""
        handles, count = self._control.constraints.handles, len(self._rest)
        return handle_rows(handles, count) if handles else sparse.csr_matrix((0, count))

    def _goals(self, placed: _Floats) -> _Floats:
        """Return where each handle (H, 3) goes from vertices that are placed: a soft one its share of the way."""
        handles = self._control.constraints.handles
        if not handles:
            return np.zeros((0, 3))
        ends = self._frame.leave(np.stack([handle.goal for handle in handles]))
        points, weights = self._handled @ placed, np.array([handle.weight for handle in handles])
        return np.asarray(points + weights[:, None] * (ends - points))

    def _pulled(self, verts: _Floats, goals: _Floats) -> _Floats:
        """Return the vertices placed, with the handles at their goals (H, 3)."""
        placed, rows = self._placed(verts), self._handled
        if not len(goals):
            return placed
        points = rows @ verts
        radius = max(_REACH * self._diagonal, _LONGEST * float(np.linalg.norm(goals - rows @ placed, axis=1).max()))
        pulls = np.stack([self._share * _wendland(np.linalg.norm(verts - each, axis=1) / radius) for each in points], 1)
        response = rows @ pulls
        for _ in range(_ROUNDS):
            missing = goals - rows @ placed
            if np.abs(missing).max() <= _THERE * self._diagonal:
                break
            verts = verts + pulls @ np.linalg.lstsq(response, missing, rcond=1e-9)[0]
            placed = self._placed(verts)
        return placed

    def _rigid(self, verts: _Floats) -> _Floats:
        """Return the vertices with the rigid parts as such, and what is around them moved along."""
        bodies = self._control.bodies
        if not bodies:
            return verts
        moved = verts.copy()
        for body in bodies:
            before = self._rest[body.verts]
            motion = closest_motion(before, verts[body.verts], scaled=body.mode is Rigidity.SIMILARITY)
            moved[body.verts] = motion.scale * before @ motion.rotation.T + motion.shift
        members, near, weight = self._around
        beside = np.ones(len(verts), bool)
        beside[members] = False
        corrections = (moved - verts)[members[near]]
        moved[beside] += (weight * self._share)[beside, None] * corrections[beside]
        return moved

    @cached_property
    def _around(self) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
        """The vertices of rigid parts, the nearest of them to each vertex (V,), and how much that one takes along."""
        members = np.concatenate([body.verts for body in self._control.bodies])
        distance, near = cKDTree(self._rest[members]).query(self._rest)
        falloff = self._control.constraints.falloff / self._frame.scale
        far = np.minimum(distance / falloff, 1.0) if falloff > 0 else (distance > 0).astype(float)
        return members, np.asarray(near, np.int64), 1 - far**2 * (3 - 2 * far)

    def _taken_back(self, seeds: NDArray[np.int64], number: int) -> _Floats:
        """Return the share (V,) of its way that each vertex keeps where these are faulty for the nth time."""
        radius = _AROUND * _GROWTH**number * self._diagonal
        distance = cKDTree(self._rest[seeds]).query(self._rest)[0]
        near = np.clip(2 - distance / radius, 0, 1)
        return np.asarray(1 - (1 - _BACK) * near**2 * (3 - 2 * near))


def _wendland(radius: _Floats) -> _Floats:
    """Return Wendland's function of distances (V,), 1 at 0 and nothing from 1 on."""
    inside = np.clip(1 - radius, 0, None)
    return np.asarray(inside**4 * (4 * radius + 1))
