"""Draw the pictures of a lesson: members of the new nouns, replay of the old ones, and pictures that are held out.

Source of replay: Robins 1995, Catastrophic forgetting, rehearsal and pseudorehearsal.

Read and keep pictures for replay: of the builtin nouns, which ship with the weights, and of nouns that were taught.

`rehearsal.zip` beside the weights holds for each noun a lossless WebP with its pictures one below the other, and
`labels.json` their prompts and azimuths (`python -m training.prior.rehearsal` writes it). Pictures of a taught noun are
tensors in its file of weights.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypedDict

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from meshdeform.assets.lesson_archive import MIN_FACES
from meshdeform.errors import AssetEmptyError, ModelError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.priors.builtin.grammar import (
    ATTRIBUTES,
    BUILTIN_WORDS,
    MAX_ATTRIBUTES,
    SEQUENCE_LENGTH,
    Attribute,
    ParsedPrompt,
    Words,
    parse,
    tokenise,
)
from meshdeform.priors.builtin.network import IMAGE_SIZE, WEIGHTS, read_tensors
from meshdeform.priors.builtin.prior import CAMERAS, STYLE
from meshdeform.priors.builtin.taught import REPLAY, words_of
from meshdeform.priors.builtin.teaching.deformed import Part, deformed, normalised
from meshdeform.priors.builtin.teaching.views import PictureSet, drawn_from, joined, pictures, single_views
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.shading import Renderer

KEPT_PICTURES, _FEWEST_KEPT = 32, 8
"""Pictures of taught nouns that their file keeps, for replay when it is taught again: of all, and at least of each."""
_OLD_TO_NEW = 2 / 3
"""Least number of pictures of old nouns in the training for each of a new one; they are repeated for it."""
_HELD_MEMBERS, _HELD_MEMBERS_EACH = 6, 2
"""Of the only noun, and of each of several."""
_HELD_GRIDS = 1
_HELD_NOUNS = 30
"""Old nouns by which a lesson measures what it forgets: every one costs a pass for each noun of the vocabulary."""
_NEW, _HELD = 0, 1
"""First numbers of the seeds of members; the second is the member, so that a set does not depend on the order."""
_FEWEST_TO_HOLD_OUT = 3


@dataclass(frozen=True)
class LessonSize:
    """How many pictures are drawn."""

    members: int = 60  # least number of members of the only noun; at least `each` of every mesh
    members_each: int = 24  # of each of several nouns
    each: int = 4
    grids: int = 3  # grids of four views of a member, in addition to one single view


@dataclass(frozen=True)
class LessonPictures:
    """The pictures of a lesson."""

    training: PictureSet  # of the new nouns and of the old ones
    held_new: PictureSet
    """Of the new nouns: other members of the meshes; of a noun with three, of a mesh that the training does not see."""
    held_old: PictureSet  # of up to 30 old nouns, one member each that the training does not see
    held_meshes: frozenset[str]  # names of the meshes that are held out
    kept: dict[str, PictureSet]  # pictures of the new nouns for the file


def draw_lesson(
    words: Words,
    shapes: Mapping[str, Sequence[Shape]],
    replayed: Mapping[str, PictureSet],
    size: LessonSize,
    seed: int,
) -> LessonPictures:
    """Draw the pictures of a lesson; the same seed gives the same pictures.

    `words`: those of the new weights; `shapes`: by noun, at least one of each; `replayed`: pictures of nouns that were
    taught before.
    """
    several = len(shapes) > 1
    if several:
        size = replace(size, members=size.members_each)
    pictures = {
        noun: _of_noun(noun, words, own, size, seed + number, _HELD_MEMBERS_EACH if several else _HELD_MEMBERS)
        for number, (noun, own) in enumerate(shapes.items())
    }
    shipped = shipped_pictures(words)
    old = [noun for noun in words.nouns if noun in shipped and noun not in pictures and noun not in replayed]
    replay = [*(shipped[noun].training for noun in old), *replayed.values()]
    held_old = [
        shipped[noun].held_out for number, noun in enumerate(old) if number * _HELD_NOUNS % len(old) < _HELD_NOUNS
    ]
    new = joined([each.training for each in pictures.values()])
    order, most = torch.Generator().manual_seed(seed), max(KEPT_PICTURES // len(pictures), _FEWEST_KEPT)
    repeats = max(1, round(len(new) * _OLD_TO_NEW / max(sum(map(len, replay)), 1)))
    return LessonPictures(
        joined([new, *replay * repeats]),
        joined([each.held_out for each in pictures.values()]),
        joined(held_old),
        frozenset(each.held_mesh for each in pictures.values() if each.held_mesh),
        {
            noun: each.training.rows(torch.randperm(len(each.training), generator=order)[:most])
            for noun, each in pictures.items()
        },
    )


@dataclass(frozen=True)
class _NounPictures:
    """The pictures of a noun, and the name of the mesh that is held out, if one is."""

    training: PictureSet
    held_out: PictureSet
    held_mesh: str


def _of_noun(noun: str, words: Words, shapes: Sequence[Shape], size: LessonSize, seed: int, held: int) -> _NounPictures:
    """Draw members of a noun, and of a mesh that they do not show if there are three."""
    number = int(np.random.default_rng(seed).integers(len(shapes)))
    apart = shapes[number] if len(shapes) >= _FEWEST_TO_HOLD_OUT else None
    seen = [shape for shape in shapes if shape is not apart]
    count = max(size.members, size.each * len(seen))
    tests = [apart] if apart is not None else seen

    def pictures_of(shape: Shape, which: tuple[int, int], grids: int) -> PictureSet:
        rng = np.random.default_rng((seed, *which))
        part, attributes = member(shape, rng)
        return _drawn(part, prompt_of(noun, attributes), words, rng, grids)

    return _NounPictures(
        joined([pictures_of(seen[k % len(seen)], (_NEW, k), size.grids) for k in range(count)]),
        joined([pictures_of(tests[k % len(tests)], (_HELD, k), _HELD_GRIDS) for k in range(held)]),
        apart.name if apart is not None else "",
    )


def _drawn(part: Part, prompt: ParsedPrompt, words: Words, rng: np.random.Generator, grids: int) -> PictureSet:
    """Render grids and one single view of a member."""
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    several, azimuths = pictures(part, grids, generator)
    alone, azimuth = single_views(part, 1, generator)
    return PictureSet(
        torch.cat([several, alone]),
        torch.tensor([tokenise(prompt, words)] * (grids + 1)),
        torch.cat([azimuths, azimuth]),
        torch.arange(grids + 1) >= grids,
    )


def replay_of(tensors: Mapping[str, PictureSet], words: Words, new: Collection[str]) -> dict[str, PictureSet]:
    """Return the kept pictures of nouns that were taught before and keep their meaning."""
    return {noun: kept for noun, kept in tensors.items() if noun in words.nouns and noun not in new}


REHEARSAL = WEIGHTS.with_name("rehearsal.zip")
LABELS = "labels.json"


class _Label(TypedDict):
    """The content of one picture: `held` pictures measure what a lesson forgets, and are never trained on."""

    prompt: str
    azimuth_deg: float
    single: bool
    held: bool


@dataclass(frozen=True)
class Rehearsal:
    """Pictures of a builtin noun: for training, and those that are held out."""

    training: PictureSet
    held_out: PictureSet


def shipped_pictures(words: Words, path: Path = REHEARSAL) -> dict[str, Rehearsal]:
    """Return the pictures of the builtin nouns that ship with the weights and that `words` knows.

    Raises ModelError: the file is missing or unreadable.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            labels: dict[str, list[_Label]] = json.loads(archive.read(LABELS))
            known = [noun for noun in labels if noun in words.nouns]
            return {noun: _rehearsal(archive.read(f"{noun}.webp"), labels[noun], words) for noun in known}
    except (OSError, zipfile.BadZipFile, KeyError, ValueError) as error:
        raise ModelError(
            f"The pictures that lessons rehearse, {path.name}, cannot be read: {error}",
            advice="Install meshdeform again: the file is part of the package.",
        ) from error


def _rehearsal(picture: bytes, labels: Sequence[_Label], words: Words) -> Rehearsal:
    """Return the pictures of a noun from its file."""
    column = np.array(Image.open(io.BytesIO(picture)).convert("RGB"))
    images = torch.from_numpy(column.reshape(len(labels), IMAGE_SIZE, IMAGE_SIZE, 3)).permute(0, 3, 1, 2).contiguous()
    pictures = PictureSet(
        images,
        torch.tensor([tokenise(parse(label["prompt"], BUILTIN_WORDS), words) for label in labels]),
        torch.tensor([label["azimuth_deg"] for label in labels], dtype=torch.float32),
        torch.tensor([label["single"] for label in labels]),
    )
    held = torch.tensor([label["held"] for label in labels])
    return Rehearsal(pictures.rows(torch.nonzero(~held)[:, 0]), pictures.rows(torch.nonzero(held)[:, 0]))


def read_replay(path: Path) -> dict[str, PictureSet]:
    """Read the pictures of nouns that a file of weights was taught, by noun; nothing for the weights in the package.

    Raises ModelError: the file is unreadable, or its pictures do not have the shapes of a `PictureSet`.
    """
    state, metadata = read_tensors(path)
    words = words_of(metadata, path)
    stored = {}
    for noun in words.nouns:
        tensors = {field.name: state.get(f"{REPLAY}{noun}.{field.name}") for field in fields(PictureSet)}
        images = tensors["images"]
        if images is None:
            continue
        shapes = {
            "images": (len(images), 3, IMAGE_SIZE, IMAGE_SIZE),
            "tokens": (len(images), SEQUENCE_LENGTH),
            "azimuth_deg": (len(images),),
            "single": (len(images),),
        }
        types = {"images": torch.uint8, "tokens": torch.int64, "single": torch.bool, "azimuth_deg": torch.float32}
        whole = {name: t for name, t in tensors.items() if t is not None and tuple(t.shape) == shapes[name]}
        if len(whole) < len(shapes) or not len(images) or any(t.dtype != types[name] for name, t in whole.items()):
            raise _unreadable(path, noun)
        kept = PictureSet(**whole)
        if not 0 <= int(kept.tokens.min()) <= int(kept.tokens.max()) < len(words.tokens):
            raise _unreadable(path, noun)
        stored[noun] = kept
    return stored


def replay_tensors(noun: str, pictures: PictureSet) -> dict[str, Tensor]:
    """Return the tensors under which a file keeps pictures of a noun."""
    return {f"{REPLAY}{noun}.{field.name}": getattr(pictures, field.name) for field in fields(PictureSet)}


def _unreadable(path: Path, noun: str) -> ModelError:
    return ModelError(
        f"The weights in {path} have unreadable pictures of {noun!r}.",
        advice="Teach the file's words again, from the weights in the package.",
    )


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

    `mesh`: world space, any size; it may be open or have many parts. `front_deg`: azimuth of its front, as in
    `params.guidance.orientation`: 0 is +Z, 90 is +X. Raises AssetEmptyError: it has fewer than 4 faces, or is so thin
    that it vanishes from some side.
    """
    if len(mesh.faces) < MIN_FACES:
        raise AssetEmptyError(
            f"{name} has {len(mesh.faces)} faces with an area; a shape to learn from needs at least {MIN_FACES}.",
            advice="Export the whole object as a mesh.",
        )
    if len(mesh.faces) > MAX_FACES:
        from meshdeform.geometry.shapes import simplified

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
    turns = {}
    for number, shape in enumerate(shapes):
        others = (total - views[number]) / (len(shapes) - 1)
        # The front at azimuth 90 k shows in view k.
        apart = [float(np.square(np.roll(views[number], -k, 0) - others).mean()) for k in range(4)]
        best = int(np.argmin(apart))
        if best and apart[best] < _CLEARLY * apart[0]:
            turns[shape.name] = 90 * best
    return turns


def prompt_of(noun: str, attributes: Sequence[Attribute]) -> ParsedPrompt:
    """Return the prompt that describes a member."""
    return ParsedPrompt(noun, tuple(sorted(set(attributes), key=ATTRIBUTES.index)))
