"""Check the meshes that a noun is taught from, and draw members of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets.lesson_archive import MIN_FACES
from meshdeform.errors import AssetEmptyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.priors.builtin.grammar import ATTRIBUTES, MAX_ATTRIBUTES, Attribute, ParsedPrompt
from meshdeform.priors.builtin.prior import CAMERAS, STYLE
from meshdeform.priors.builtin.teaching.deformed import Part, deformed, normalised
from meshdeform.priors.builtin.teaching.picture_set import drawn_from
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer

MAX_FACES = 20_000
"""Larger meshes are simplified: a view has 64 pixels."""
_SMALLEST_SHARE = 0.004
"""Least share of a view's pixels that a shape must cover, seen from the side where it shows least."""
_SCALE, _SHEAR = 0.1, 0.03
"""Jitter of a member: range of the scale of each axis, and standard deviation of the shears."""
_PLAIN_ODDS = (2 / 3, 1 / 3, 0.0)
"""Odds of no and of one attribute that deforms the whole member."""
_WHOLE = tuple(attribute for attribute in ATTRIBUTES if attribute.part == "whole")
_CLEARLY = 0.75
"""A mesh seems turned if another quarter turn has at most this share of its difference from the others."""


@dataclass(frozen=True)
class Shape:
    """A mesh to learn from."""

    name: str  # of its file
    part: Part  # +Y up, facing +Z, centred, farthest vertex at distance 1
    attributes: tuple[Attribute, ...] = ()  # what it is labelled with


def shape_of(mesh: TriangleMesh, name: str, *, front_deg: float = 0.0, attributes: Sequence[Attribute] = ()) -> Shape:
    """Prepare a welded mesh (+Y up), and check that something of it can be seen.

    Parameters
    ----------
    mesh : TriangleMesh
        World space, any size; it may be open or have many parts.
    front_deg : float
        Azimuth of its front, as in `params.guidance.orientation`: 0 is +Z, 90 is +X.

    Raises
    ------
    AssetEmptyError
        It has fewer than 4 faces, or is so thin that it vanishes from some side.
    """
    if len(mesh.faces) < MIN_FACES:
        raise AssetEmptyError(
            f"{name} has {len(mesh.faces)} faces with an area; a shape to learn from needs at least {MIN_FACES}.",
            advice="Export the whole object as a mesh.",
        )
    if len(mesh.faces) > MAX_FACES:
        from meshdeform.geometry.simplify import simplified

        mesh = simplified(mesh, MAX_FACES)
    turn = np.radians(-front_deg)
    cos, sin = np.cos(turn), np.sin(turn)
    about_y = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    shape = Shape(name, normalised(Part(mesh.verts.numpy() @ about_y.T, mesh.faces.numpy())), tuple(attributes))
    shares = (four_views(shape.part) > 0).any(-1).mean((1, 2))
    if shares.min() < _SMALLEST_SHARE:
        raise AssetEmptyError(
            f"{name} covers {shares.min():.2%} of a picture from its thinnest side: nearly nothing but background.",
            advice="Leave out what makes the object small, such as a ground plane or a lone part far away.",
        )
    return shape


def four_views(part: Part) -> NDArray[np.float32]:
    """Render four views a quarter turn apart (4, S, S, 3), of the middle elevation."""
    verts = torch.from_numpy(part.verts)
    renderer = Renderer(torch.from_numpy(part.faces), len(verts), STYLE)
    cameras = fixed_cameras(0.0, CAMERAS.elevation_max_deg / 2, CAMERAS.fov_min_deg)
    with torch.no_grad():
        views: NDArray[np.float32] = renderer.render(verts, cameras)[..., :3].numpy()
    return views


def member(shape: Shape, rng: np.random.Generator) -> tuple[Part, tuple[Attribute, ...]]:
    """Draw a member: the shape, jittered, sometimes with an attribute of the whole, which is true by construction."""
    matrix = np.diag(rng.uniform(1 - _SCALE, 1 + _SCALE, 3)) + rng.normal(0.0, _SHEAR, (3, 3)) * (1 - np.eye(3))
    part = normalised(Part(shape.part.verts @ matrix.T, shape.part.faces))
    attributes = shape.attributes
    if len(attributes) < MAX_ATTRIBUTES:
        free = [extra for extra in _WHOLE if not attributes]
        added = drawn_from("", free, _PLAIN_ODDS, rng).attributes if free else ()
        part = deformed(part, added, rng)
        attributes = (*attributes, *added)
    return part, attributes


def seen_turned(shapes: Sequence[Shape]) -> dict[str, int]:
    """Return the names of meshes that seem to face another way than the others, with the azimuth of their front.

    Each mesh is compared with the mean picture of the others from four sides. Meshes that look alike from all sides are
    never named.
    """
    if len(shapes) < 3:
        return {}
    views = np.stack([four_views(shape.part) for shape in shapes])
    total = views.sum(0)
    found = {}
    for number, shape in enumerate(shapes):
        others = (total - views[number]) / (len(shapes) - 1)
        # The front at azimuth 90 k shows in view k.
        apart = [float(np.square(np.roll(views[number], -k, 0) - others).mean()) for k in range(4)]
        best = int(np.argmin(apart))
        if best and apart[best] < _CLEARLY * apart[0]:
            found[shape.name] = 90 * best
    return found


def prompt_of(noun: str, attributes: Sequence[Attribute]) -> ParsedPrompt:
    """Return the prompt that describes a member."""
    return ParsedPrompt(noun, tuple(sorted(set(attributes), key=ATTRIBUTES.index)))
