"""Read the prompts of a job: their texts, their weights, and the faces of the asset that each pulls at.

With the weight w_i of prompt i, and m_i(f) in 0 .. 1 how much of face f it pulls at, the face gets the share::

    w_i m_i(f) / max(1, sum_j w_j m_j(f))          m_i(f) = h^2 (3 - 2 h),   h = min(1, d_i(f) / fall-off)

of the prompt's gradient, with d_i(f) the distance of the face from what is outside of its regions, along the surface. A
prompt without regions pulls at everything, m_i = 1. Where m_i could not reach 1, because a region is narrower than four
fall-offs, its fall-off is half of its greatest depth. Where nothing is optimised, a vertex is moved by each prompt by
the mean share of the faces around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.deformation.constraints import surface_distances
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh
from meshdeform.guidance.weighted import WeightedPrompt
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.parameters import WeightedPromptParams, active_prompts
from meshdeform.runs.control import AssetControl, WeldedSurface

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Prompts:
    """The prompts of a job that pull at anything."""

    given: list[WeightedPromptParams] = field(default_factory=list)
    faces: list[_Flags | None] = field(default_factory=list)
    """list of (F,) bool or None: the faces of the welded mesh that each pulls at; None for everything."""
    texts: list[WeightedPrompt] = field(default_factory=list)  # the same, for the guidance
    shares: list[_Floats] = field(default_factory=list)
    """list of (F,) float64: for each group of `texts`, the share of its gradient that each face gets; empty if all get
    everything."""

    @property
    def main(self) -> str:
        """The first prompt that pulls at everything; empty if there is none."""
        return next((each.prompt for each, faces in zip(self.given, self.faces, strict=True) if faces is None), "")

    def of_vertices(self, mesh: RestMesh) -> list[_Floats]:
        """Return the share (V,) of each prompt in what moves each vertex: the mean of the faces around it."""
        if not self.shares:
            return [np.full(len(mesh.verts), each.weight) for each in self.texts]
        corners, areas = mesh.faces.ravel(), np.maximum(mesh.areas, 1e-300)
        total = np.bincount(corners, np.repeat(areas, 3), len(mesh.verts))

        def around(of_face: _Floats) -> _Floats:
            gathered = np.bincount(corners, np.repeat(areas * of_face, 3), len(mesh.verts))
            return np.asarray(gathered / np.maximum(total, 1e-300))

        return [each.weight * around(self.shares[each.group]) for each in self.texts]


def read_prompts(
    prompt: str, params: ResolvedParams, surface: WeldedSurface, mesh: RestMesh, control: AssetControl
) -> Prompts:
    """Return the prompts of a request.

    `prompt`: that of the request; `surface`: in the file's units; `mesh`: the welded mesh in the cameras' frame;
    `control`: with a symmetry, a region has its mirror image as well.
    """
    active = active_prompts(prompt, params.prompts)
    # Their numbers in the request, for errors.
    numbers = [None] * bool(prompt) + [n for n, each in enumerate(params.prompts) if each.weight > 0]
    faces = [
        None if number is None or not each.regions else _faces_pulled(number, each, surface, control)
        for number, each in zip(numbers, active, strict=True)
    ]
    faces = [None if flags is not None and flags.all() else flags for flags in faces]
    if all(flags is None for flags in faces):
        scale = max(1.0, sum(each.weight for each in active))
        return Prompts(active, faces, [WeightedPrompt(each.prompt, each.weight / scale) for each in active])
    masks, groups = _distinct_regions(faces)
    falloff = params.falloff * float(np.linalg.norm(np.ptp(mesh.verts, axis=0)))
    pulls = [np.ones(len(mesh.faces)) if mask is None else _pull_of_faces(mesh, mask, falloff) for mask in masks]
    total = sum(each.weight * pulls[group] for each, group in zip(active, groups, strict=True))
    shares = [pull / np.maximum(1.0, total) for pull in pulls]
    texts = [WeightedPrompt(each.prompt, each.weight, group) for each, group in zip(active, groups, strict=True)]
    return Prompts(active, faces, texts, shares)


def _faces_pulled(number: int, prompt: WeightedPromptParams, surface: WeldedSurface, control: AssetControl) -> _Flags:
    """Return flags (F,) of the faces that a prompt with regions pulls at."""
    path = ("guidance", "prompts", number, "regions")
    pulled = np.any([surface.faces(path, index, region) for index, region in enumerate(prompt.regions)], axis=0)
    flags = np.asarray(~pulled if prompt.outside else pulled)
    if control.partners is not None:
        flags = flags | _mirrored(flags, surface.mesh, control.partners.axis)
    if not flags.any():
        raise _refusal(number, "its regions are the whole asset, so nothing is outside.", "Select less.")
    kept = control.constraints.kept
    if kept is not None and kept[surface.mesh.faces[flags]].all():
        raise _refusal(number, "all that it pulls at is kept.", "Keep less, or leave the prompt out.")
    return flags


def _mirrored(flags: _Flags, mesh: RestMesh, axis: int) -> _Flags:
    """Return flags of the mirror images of flagged faces."""
    verts = mesh.verts
    middles = verts[mesh.faces].mean(1)
    images = middles.copy()
    images[:, axis] = verts[:, axis].min() + verts[:, axis].max() - images[:, axis]
    return np.asarray(flags[cKDTree(middles).query(images)[1]])


def _distinct_regions(faces: Sequence[_Flags | None]) -> tuple[list[_Flags | None], list[int]]:
    """Return the different regions, and the number of each prompt's among them."""
    grouped: list[_Flags | None] = []
    groups = []
    for flags in faces:
        group = next((n for n, other in enumerate(grouped) if _same_region(flags, other)), len(grouped))
        if group == len(grouped):
            grouped.append(flags)
        groups.append(group)
    return grouped, groups


def _same_region(one: _Flags | None, other: _Flags | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)


def _pull_of_faces(mesh: RestMesh, flags: _Flags, falloff: float) -> _Floats:
    """Return how much of each face (F,) a prompt pulls at."""
    faces = mesh.faces
    outside = np.zeros(len(mesh.verts), bool)
    outside[faces[~flags].ravel()] = True
    if falloff <= 0:
        return flags.astype(np.float64)
    depths = np.minimum(surface_distances(mesh, outside, limit=2 * falloff), 2 * falloff)
    of_face = depths[faces].mean(1) * flags
    deepest = float(of_face.max())
    if deepest <= 0:  # so narrow that all its corners are outside as well
        return flags.astype(np.float64)
    near = np.minimum(of_face / min(falloff, deepest / 2), 1.0)
    return np.asarray(near**2 * (3 - 2 * near))


def _refusal(number: int, what: str, advice: str) -> ParameterError:
    detail = f"params.guidance.prompts.{number}: {what}"
    return ParameterError.at(["params", "guidance", "prompts", number, "regions"], detail, advice)
