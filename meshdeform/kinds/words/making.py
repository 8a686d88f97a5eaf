"""Make a word of one's own of meshes. Without torch, but where nobody says what the meshes are like.

All files are read before anything is made, so that what is wrong with any of them is told at once. Each mesh is reduced
first; parts are read on what is kept. What the first is like, the judge and the reading say; if that is likely,
the parts of all are read as that noun's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.check import has_area
from meshdeform.assets.collection import meshes_in
from meshdeform.errors import AssetEmptyError, AssetError, ParameterError
from meshdeform.kinds.words.shapes import Parted, parted, reduced, shape_of, turn_between
from meshdeform.plain.body import loose_body
from meshdeform.plain.reader import Reader
from meshdeform.requests.choices import OrientationMode
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.base import sha256_hex
from meshdeform.runs.kept_readings import Readings, Unkept
from meshdeform.runs.reading import ReadingSource as ReadSource
from meshdeform.runs.reading import corrected, read_source
from meshdeform.words import MAX_SHAPES, ShapeSource, Word, WordOffer, WordShape, write_word
from meshdeform.words.limits import MAX_TEXT

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.plain.body import Body

__all__ = ["make_word"]

_FITTED = 3
"""Members that are fitted to each mesh. With five, as jobs have, parts are not nearer to those of the whole mesh."""
_LIKELY = 0.5
"""Probability of its noun from which the first mesh says what all are like."""


def make_word(
    offer: WordOffer, files: Mapping[str, bytes], limits: Limits | None = None, readings: Readings | None = None
) -> Word:
    """Return the word of meshes.

    Parameters
    ----------
    files : mapping
        Meshes by the names of their files, as `load_asset` takes them, or ZIPs of several.
    limits : Limits, optional
        Of each file.
    readings : Readings, optional
        Where samples of nouns are kept.

    Raises
    ------
    AssetError
        A file is damaged or has no surface; of several, the message tells all.
    ParameterError
        There are too many files, two face differently, or the licence is too long.
    """
    limits = limits or Limits()
    files = meshes_in(files, limits)
    if not 1 <= len(files) <= MAX_SHAPES:
        raise ParameterError(f"A word has 1 to {MAX_SHAPES} meshes, not {len(files)}.", advice="Choose some of them.")
    if len(offer.licence) > MAX_TEXT:
        detail = f"A licence has at most {MAX_TEXT} characters, and this has {len(offer.licence):,}."
        raise ParameterError.at(["licence"], detail, "Name it, or give its address.")
    if unknown := sorted(offer.fronts.keys() - files.keys()):
        raise ParameterError.at(["front"], f"There is no mesh {unknown[0]!r}.", f"Name one of: {', '.join(files)}.")
    like, meshes = _parted(_loaded(files, limits), offer, readings or Unkept())
    numbers: dict[str, int] = {}
    shapes = {name: shape_of(mesh, numbers) for name, mesh in meshes.items()}
    _check_fronts(shapes, meshes, offer)
    sources = [ShapeSource(name[-MAX_TEXT:], sha256_hex(data), offer.licence) for name, data in files.items()]
    return write_word(
        offer.noun, [*shapes.values()], sources, parts=[*numbers], synonyms=tuple(offer.synonyms), like=like
    )


def _loaded(files: Mapping[str, bytes], limits: Limits) -> dict[str, Asset]:
    """Return all assets, or tell what is wrong with each that is damaged."""
    assets, wrong = dict[str, "Asset"](), dict[str, AssetError]()
    for name, data in files.items():
        try:
            assets[name] = load_asset(data, name, limits)
            if not has_area(assets[name].surface):
                raise AssetEmptyError(
                    "Every triangle of the asset has zero area.", advice="Send a mesh with a surface."
                )
        except AssetError as error:
            wrong[name] = error
    if wrong:
        raise _refusal(wrong, len(files))
    return assets


def _refusal(wrong: Mapping[str, AssetError], count: int) -> AssetError:
    """Return one error about all files that cannot be used."""
    first = next(iter(wrong.values()))
    if count == 1:
        return first
    listed = " ".join(f"{name}: {error.detail}" for name, error in wrong.items())
    told = [{"file": name, "code": error.code, "detail": error.detail} for name, error in wrong.items()]
    detail = f"{len(wrong)} of {count} files cannot be used, and nothing was kept. {listed}"
    return type(first)(detail, advice="Leave these out, or repair them.", files=told)


def _parted(assets: Mapping[str, Asset], offer: WordOffer, readings: Readings) -> tuple[str, dict[str, Parted]]:
    """Return the noun that all are like, or an empty text, and the meshes with their parts."""

    def body_of(name: str, like: str) -> Body:
        front = offer.front_of(name)
        said = {"source_noun": like or None, "orientation": OrientationMode.AUTO if front is None else front}
        params = resolve(DeformParams()).model_copy(update=said)
        body = reduced(corrected(loose_body(assets[name]), assets[name], params))
        source = ReadSource("", name, kept=readings)  # a reading of a reduced mesh is none of its file
        return replace(body, reader=Reader(lambda: read_source(body, params, source, fitted=_FITTED)))

    first, *others = assets
    body = body_of(first, offer.like)
    reading = body.reader.reading
    like = offer.like or (reading.noun if reading is not None and reading.probability >= _LIKELY else "")
    bodies = {first: body} | {name: body_of(name, like) for name in others}
    return like, {
        name: parted(each, each.reader.reading if like else None, offer.front_of(name)) for name, each in bodies.items()
    }


def _check_fronts(shapes: Mapping[str, WordShape], meshes: Mapping[str, Parted], offer: WordOffer) -> None:
    """Refuse shapes that face another way than the first, unless somebody says where they face."""
    first, *others = shapes
    asked = [name for name in others if offer.front_of(name) is None]
    turned = {name: turn for name in asked if (turn := turn_between(shapes[first], shapes[name]))}
    if not turned:
        return
    fronts = {name: round(meshes[name].front_deg + turn) % 360 for name, turn in turned.items()}
    raise ParameterError.at(
        ["front"],
        f"Meshes of a word face one way, and these do not face as {first} does: {', '.join(turned)}.",
        f"Turn them, or say where they face: {' '.join(f'--front {name}={front}' for name, front in fronts.items())}.",
    )
