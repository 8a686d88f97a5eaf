"""Read the source of a job, its noun, its front and its parts, and lay over it what a request says of them.

The judge and the likeness to members propose nouns, and fits decide among them (`meshdeform.reading`), unless the
request gives one. Nothing is read until somebody asks, and nothing twice: readings are kept by what they depend on
(`kept_readings`). Importing this loads no torch.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

import meshdeform
from meshdeform import plain
from meshdeform.errors import ModelError, ShapeError
from meshdeform.plain.evidence import read_body
from meshdeform.plain.joints import is_person
from meshdeform.plain.reader import Reader
from meshdeform.reading import FITTED, Reading
from meshdeform.reading.likeness import nouns_alike
from meshdeform.reading.result import UP_TURNS
from meshdeform.requests.choices import METRES, LengthUnit, UpAxis
from meshdeform.runs.kept_readings import Readings, Unkept, given_front, given_noun, key_of
from meshdeform.runs.parted import given_parts
from meshdeform.runs.selectable import SelectableSurface
from meshdeform.support.recent import Recent
from meshdeform.vocabulary.nouns import NOUN_GROUPS
from meshdeform.words.near import words_near

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.geometry.weld import WeldedMesh
    from meshdeform.plain.body import Body, Flags, Floats, Index
    from meshdeform.requests.document import ResolvedParams
    from meshdeform.requests.selection import PartParams

__all__ = [
    "ReadingSource",
    "corrected",
    "read_source",
    "reading_document",
    "reading_report",
    "reshaped",
    "welded_body",
]

_MOST, _DIGITS = 5, 4
"""How many nouns are told, and digits of a probability."""

_JUDGE = Path(meshdeform.__file__).parent / "judge" / "weights" / "judge.safetensors"
"""As `meshdeform.judge.WEIGHTS`, which loads what draws."""

_Z_UP, _Z_UP_ELSE = {".stl": 0.8, ".ply": 0.5}, 0.1
"""Share of files of a format in which +Z is up: printers and CAD have it so, and most of what writes the others has
not."""

_EVIDENCE = tuple(Path(plain.__file__).with_name(name) for name in ("evidence.py", "joints.py", "names.py"))
"""What says what joints and names tell: `meshdeform.reading.VERSION` does not know it."""

_UNLIKELY, _UNJUDGED = 0.001, 0.02
"""What counts as the judge's probability of a noun besides, and in place of it where it does not know the noun."""
_CLEARLY = 0.5
"""Probability from which a figure is another than a person."""
_MOST, _MOST_BYTES = 64, 64 * 2**20
"""Readings that this process keeps, and the bytes of their labels."""

_log = logging.getLogger(__name__)
_last: Recent[Reading] = Recent(_MOST, _MOST_BYTES)


@dataclass(frozen=True)
class ReadingSource:
    """The file of a job, and where readings of it are kept."""

    digest: str  # SHA-256 of its bytes, hexadecimal; empty: nothing is kept
    filename: str
    subdivided: bool = False
    kept: Readings = field(default_factory=Unkept)

    def key(self, params: ResolvedParams) -> str:
        """Return the key of its reading."""
        suffix = PurePath(self.filename).suffix
        return key_of(self.digest, suffix, params, subdivided=self.subdivided)


def corrected(body: Body, asset: Asset, params: ResolvedParams, source: ReadingSource | None = None) -> Body:
    """Return a body with a reader of it, and with the axis, the unit and the parts that its file and the request say.

    Raises ParameterError: a correction selects nothing of the surface.
    """
    up = body.up if params.up is UpAxis.AUTO else params.up.value
    unit = body.unit if params.unit is LengthUnit.AUTO else METRES[params.unit]
    body = replace(body, up=up, unit=unit)
    painted, renamed = _corrections(body, asset, params.parts)
    found = Reader(lambda: read_source(body, params, source))
    return replace(body, reader=found, painted=painted, renamed=renamed)


def welded_body(asset: Asset, welded: WeldedMesh, params: ResolvedParams, source: ReadingSource | None = None) -> Body:
    """Return the body of an asset that was welded, as `corrected` does."""
    from meshdeform.plain.body import body_of

    body = body_of(asset, welded.vertex_map, welded.first_rows(), welded.mesh.faces)
    return corrected(body, asset, params, source)


def reshaped(body: Body, points: Floats, params: ResolvedParams, source: ReadingSource) -> Body:
    """Return a body with its vertices at other places (V, 3), which is read as it is there; the reading is not kept."""
    moved = body.moved(points)
    found = Reader(lambda: read_source(moved, params, replace(source, digest="")))
    return replace(moved, reader=found)


def _corrections(
    body: Body, asset: Asset, corrections: tuple[PartParams, ...]
) -> tuple[dict[str, Flags], dict[str, str]]:
    """Return the faces (F,) of each part that the file names or the request paints, and new names.

    What a later correction selects, no other part has.
    """
    painted: dict[str, Flags] = given_parts(asset, body)
    renamed = {old: each.name for each in corrections for old in each.parts or ()}
    if all(each.parts for each in corrections):
        return painted, renamed
    surface = SelectableSurface.of_body(asset, body)
    for number, each in enumerate(corrections):
        if each.parts is not None:
            continue
        flags, part = surface.faces(("control", "parts"), number, each), each.name
        before = painted.get(part, np.zeros(len(flags), bool))
        painted = {name: taken & ~flags for name, taken in painted.items()} | {part: before | flags}
    return painted, renamed


def read_source(
    body: Body, params: ResolvedParams, source: ReadingSource | None = None, *, fitted: int = FITTED
) -> Reading | None:
    """Read a body, or return what was kept of it; None if it cannot be read.

    `params`: give the noun or the front; `source`: the file that it is of, else nothing is kept; `fitted`: how many
    members are fitted. None: it has no area, or no noun is given and the judge is missing.
    """
    key = "" if source is None or not source.digest else source.key(params)
    if key and (known := _last.get(key) or _unpacked(source.kept.get(key) if source else None)) is not None:
        if len(known.labels) == len(body.faces):
            _last.put(key, known, known.labels.nbytes)
            return known
        _log.warning("a kept reading is of another mesh; it is read anew")
    reading = _read(body, params, source, fitted)
    if reading is not None and key and source is not None:
        _last.put(key, reading, reading.labels.nbytes)
        source.kept.put(key, _head() + reading.to_bytes())
    return reading


def _read(body: Body, params: ResolvedParams, source: ReadingSource | None, fitted: int) -> Reading | None:
    samples, suffix = (None, "") if source is None else (source.kept.samples, PurePath(source.filename).suffix.lower())
    try:
        nouns = _proposed(body.points, body, params)
        if not nouns:
            return None
        z_up = None if body.up == "y" else _proposed(body.points @ UP_TURNS["+Z"].T, body, params)
        share = 1.0 if body.up == "z" else _Z_UP.get(suffix, _Z_UP_ELSE)
        return read_body(body, nouns, given_front(params), samples, z_up=z_up, z_share=share, fitted=fitted)
    except (ShapeError, ValueError) as error:
        _log.info("the asset is not read: %s", error)
        return None


def _proposed(points: Floats, body: Body, params: ResolvedParams) -> Mapping[str, float]:
    """Return the nouns that a body with its vertices at these points may be, with their probabilities.

    They are what the judge says, by pictures, times what members of the nouns are like. With the joints of a person
    it is one, unless it clearly is another figure: to the judge, whoever holds out both arms looks like a helicopter.
    """
    given = given_noun(params)
    if given is not None:
        return {given: 1.0}
    judged = _judged(points, body.faces)
    figure = any(judged[noun] >= _CLEARLY for noun in judged.keys() & NOUN_GROUPS["figures"])
    if not judged:
        return {}
    if not figure and is_person(joint.name for joint in body.joints):
        nouns = {"person": 1.0}
    else:
        alike = nouns_alike(points, body.faces)
        both = {noun: share * (judged.get(noun, _UNJUDGED) + _UNLIKELY) for noun, share in alike.items()}
        nouns = {noun: each / sum(both.values()) for noun, each in both.items()}
    return {**nouns, **{word.noun: 0.0 for word in words_near(points, body.faces)}}


def _judged(points: Floats, faces: Index) -> Mapping[str, float]:
    """Return the probabilities that the judge gives all nouns; none if it is missing."""
    from meshdeform.geometry.mesh import TriangleMesh
    from meshdeform.judge import Judge

    try:
        return Judge().noun_probabilities(TriangleMesh(points, faces), of_public=True)
    except ModelError as error:
        _log.warning("the source is not recognised: %s", error)
        return {}


@lru_cache(maxsize=1)
def _head() -> bytes:
    """Return what a kept reading begins with: whatever decides it besides its key and the version of readings."""
    weights = hashlib.sha256(_JUDGE.read_bytes()).hexdigest() if _JUDGE.is_file() else "none"
    evidence = hashlib.sha256(b"".join(path.read_bytes() for path in _EVIDENCE)).hexdigest()
    return f"meshdeform {meshdeform.__version__}, judge {weights}, evidence {evidence}\n".encode()


def _unpacked(data: bytes | None) -> Reading | None:
    """Return a kept reading; None if there is none, or it is damaged or another version's."""
    if data is None or not data.startswith(_head()):
        return None
    try:
        return Reading.from_bytes(data[len(_head()) :])
    except (ValueError, TypeError, KeyError) as error:
        _log.info("a kept reading is of no use: %s", error)
        return None


def reading_document(reading: Reading | None, params: ResolvedParams) -> dict[str, Any] | None:
    """Return what a reading says of the whole, as the API and reports have it; None if there is none."""
    if reading is None:
        return None
    likely = sorted(reading.probabilities.items(), key=lambda item: -item[1])
    return {
        "noun": reading.noun,
        "probability": round(reading.probability, _DIGITS),
        "sure": reading.sure,
        "nouns": [{"noun": noun, "probability": round(each, _DIGITS)} for noun, each in likely[:_MOST]],
        "noun_given": given_noun(params) is not None,
        "up": reading.up,
        "front_azimuth_deg": round(reading.front_azimuth_deg, 1) + 0.0,
        "front_sure": reading.front_sure,
        "front_given": given_front(params) is not None,
    }


def reading_report(reading: Reading | None, params: ResolvedParams) -> dict[str, Any] | None:
    """Return the member `reading` of a report: also what parts were found, and by which member of the noun."""
    document = reading_document(reading, params)
    if reading is None or document is None:
        return None
    parts = {name: round(confidence, _DIGITS) for name, confidence in reading.confidence.items()}
    return {**document, "parts": parts, "member": reading.member, "residual": round(reading.residual, 6)}
