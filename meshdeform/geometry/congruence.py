"""Find the connected components of a mesh that are congruent to each other, and those of revolution.

Components of equally many vertices and faces whose sorted distances from their centres agree are compared in full: the
one is turned onto the other vertex by vertex, as copies of one mesh have the same order, or else along the principal
axes. A component is of revolution if turning it about a principal axis leaves every point close to the surface.

`closest_motion` finds the rigid motion or similarity that takes points closest to others (Umeyama 1991, Least-Squares
Estimation of Transformation Parameters Between Two Point Patterns).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.geometry.mesh import RestMesh

_CONGRUENT = 1e-3
"""Greatest distance between corresponding points of congruent components, as a share of their radius."""
_ROUND = 0.08
"""Greatest distance of a turned point from the surface, as a share of the radius: a regular prism of eight sides has
0.076 = 1 - cos(pi / 8)."""
_EQUAL_MOMENTS = 0.05
_ANGLES = np.pi * np.array([0.13, 0.31, 0.5, 0.77])
_SAMPLES, _TURNED = 6_000, 100
_FEW_FACES = 12
_SIGNS = [np.diag(signs) for signs in itertools.product((1.0, -1.0), repeat=3)]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class Component:
    """A connected component."""

    number: int  # its label in `RestMesh.components`
    points: _Floats  # its vertices, in the order of the mesh
    faces: _Index  # its faces, as indices into `points`

    @property
    def radius(self) -> float:
        """Greatest distance of a vertex from their mean."""
        return float(np.linalg.norm(self.points - self.points.mean(0), axis=1).max())


def components_of(mesh: RestMesh) -> list[Component]:
    """Return the components that have faces, by number."""
    faces, label = mesh.faces, mesh.components
    of_face = label[faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    numbers, starts = np.unique(of_face[order], return_index=True)
    components = []
    for number, own in zip(numbers.tolist(), np.split(faces[order], starts[1:]), strict=True):
        used, local = np.unique(own, return_inverse=True)
        components.append(Component(number, mesh.verts[used], local.reshape(-1, 3)))
    return components


def congruent_groups(components: list[Component]) -> list[list[int]]:
    """Return the numbers of the components of each group of two or more congruent ones; mirrored ones count."""
    groups: dict[tuple[int, int], list[tuple[Component, _Floats, list[int]]]] = {}
    for component in components:
        distances = np.sort(np.linalg.norm(component.points - component.points.mean(0), axis=1))
        alike = groups.setdefault((len(component.points), len(component.faces)), [])
        for first, profile, numbers in alike:
            close = float(np.abs(profile - distances).max()) <= _CONGRUENT * profile[-1]
            if close and _coincide(first, component):
                numbers.append(component.number)
                break
        else:
            alike.append((component, distances, [component.number]))
    groups_found = [numbers for alike in groups.values() for _, _, numbers in alike if len(numbers) > 1]
    return sorted(groups_found)


def is_of_revolution(component: Component) -> bool:
    """Return whether a component is round about an axis, as wheels, rivets and balls are."""
    if len(component.faces) < _FEW_FACES:
        return False
    corners = component.points[component.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    if not areas.sum() > 0:
        return False
    centre, moments, axes = _principal(corners, areas)
    samples = _samples(corners, areas)
    tree = cKDTree(samples)
    gap = 2 * float(np.median(tree.query(samples[:_TURNED], k=2)[0][:, 1]))
    rim = component.points[:: max(1, len(component.points) // _TURNED)] - centre
    for axis in range(3):
        others = np.delete(moments, axis)
        if others[1] - others[0] > _EQUAL_MOMENTS * others[1]:
            continue
        direction = axes[:, axis]
        width = float(np.linalg.norm(np.cross(rim, direction), axis=1).max())
        turned = np.concatenate([rim @ _turn(direction, angle).T for angle in _ANGLES]) + centre
        if width > 0 and float(tree.query(turned)[0].max()) <= _ROUND * width + gap:
            return True
    return False


def _coincide(first: Component, second: Component) -> bool:
    """Return whether a rigid motion or a reflection takes the one to the other."""
    limit = _CONGRUENT * first.radius
    if closest_motion(first.points, second.points, mirrored=True).max_distance <= limit:
        return True
    goal, tree = second.points.mean(0), cKDTree(second.points)
    arms = (first.points - first.points.mean(0)) @ _axes(first.points)
    for signs in _SIGNS:
        distance, nearest = tree.query(goal + arms @ signs @ _axes(second.points).T)
        if float(distance.max()) <= limit and len(np.unique(nearest)) == len(nearest):
            return True
    return False


def _axes(points: _Floats) -> _Floats:
    return np.asarray(np.linalg.eigh(np.cov((points - points.mean(0)).T))[1])


def _turn(axis: _Floats, angle: float) -> _Floats:
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross))


def _principal(corners: _Floats, areas: _Floats) -> tuple[_Floats, _Floats, _Floats]:
    """Return the centroid of a surface, and its second moments with their axes as columns, smallest first."""
    shares = areas / areas.sum()
    centre = (shares[:, None] * corners.mean(1)).sum(0)
    arms = np.concatenate([corners - centre, (corners - centre).sum(1, keepdims=True)], axis=1)
    spread = np.einsum("f,fka,fkb->ab", shares / 12, arms, arms)  # exact for a triangle
    return centre, *np.linalg.eigh(spread)


def _samples(corners: _Floats, areas: _Floats) -> _Floats:
    """Return points that lie evenly on triangles (f, 3, 3); the same ones for the same triangles."""
    random = np.random.default_rng(0)
    chosen = random.choice(len(corners), _SAMPLES, p=areas / areas.sum())
    root, share = np.sqrt(random.random(_SAMPLES)), random.random(_SAMPLES)
    weights = np.stack([1 - root, root * (1 - share), root * share], 1)
    return np.asarray((weights[:, :, None] * corners[chosen]).sum(1))


@dataclass(frozen=True)
class Similarity:
    """The map ``scale * rotation @ x + shift``."""

    rotation: _Floats  # (3, 3) float64: orthogonal; a reflection only if those were allowed
    scale: float
    shift: _Floats  # (3,) float64
    max_distance: float  # greatest distance between a point that it maps and that point's goal


def closest_motion(before: _Floats, after: _Floats, *, scaled: bool = False, mirrored: bool = False) -> Similarity:
    """Return the motion that takes `before` (N, 3) closest to `after` (N, 3) in the sense of least squares.

    Parameters
    ----------
    before, after : (N, 3) float64
    scaled : bool
        Whether it may scale.
    mirrored : bool
        Whether it may reflect.
    """
    start, goal = before.mean(0), after.mean(0)
    arms, reached = before - start, after - goal
    u, sizes, vh = np.linalg.svd(reached.T @ arms)
    signs = np.ones(3)
    if not mirrored:
        signs[2] = np.sign(np.linalg.det(u @ vh))
    rotation = (u * signs) @ vh
    spread = float((arms**2).sum())
    scale = float((sizes * signs).sum()) / spread if scaled and spread > 0 else 1.0
    distances = np.linalg.norm(scale * arms @ rotation.T - reached, axis=1)
    return Similarity(rotation, scale, goal - scale * rotation @ start, float(distances.max(initial=0.0)))
