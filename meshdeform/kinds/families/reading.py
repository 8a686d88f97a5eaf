"""Read the members of a collection by their nouns: what an inference knows of their parts before it begins.

Each member is read as what it is most likely to be (`runs/reading.py`). Nouns that few of the collection are said to be
are not believed: their members are read again, as the noun that most are. Of a kit of many things, where no noun is
that of most, each is believed that is not unlikely by itself; else what others are counts too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.plain.body import loose_body
from meshdeform.plain.naming import faces_among
from meshdeform.reading import NO_PART
from meshdeform.requests.choices import UpAxis
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.base import sha256_hex
from meshdeform.runs.kept_readings import Readings
from meshdeform.runs.reading import ReadingSource, corrected, read_source
from meshdeform.vocabulary.nouns import TABLE
from meshdeform.vocabulary.solids import PART_NAMES

__all__ = ["MemberReading", "agreed_nouns", "named_parts", "read_member"]

_FITTED = 3
_BELIEVED, _OF_MOST = 0.15, 0.5
"""Share of the collection that a noun must have to be believed, where one noun is that of the second share of it."""
_SURE, _VERY_SURE = 0.3, 0.9
"""Probabilities of a member's noun from which on it is believed where none is: if it is of the kind that most are, such
as vehicles, and if it is not."""
_FEWEST, _LEAST_AREA = 0.1, 0.01
"""Share of the members that must have a part for it to count, and of their area."""
_MOST_PARTS = 15


@dataclass(frozen=True)
class MemberReading:
    """What one member was read as; `noun` is empty and all are `NO_PART` if it could not be read.

    `codes` (F,) int64: the part of each triangle, a place in `PART_NAMES`, or below 0; `sure` (F,) float64: the
    probability that it is right.
    """

    noun: str
    probabilities: dict[str, float]
    codes: NDArray[np.int64]
    sure: NDArray[np.float64]


def read_member(asset: Asset, data: bytes, name: str, noun: str | None, readings: Readings) -> MemberReading:
    """Read a member that stands upright, as a noun if one is given; a reading is kept by the SHA-256 of the file."""
    params = resolve(DeformParams()).model_copy(update={"source_noun": noun, "up": UpAxis.Y})
    body = corrected(loose_body(asset), asset, params)
    reading = read_source(body, params, ReadingSource(sha256_hex(data), name, kept=readings), fitted=_FITTED)
    codes = np.full(len(asset.surface.triangles), NO_PART, np.int64)
    sure = np.zeros(len(codes))
    if reading is None:
        return MemberReading("", {}, codes, sure)
    codes[faces_among(body.vertex_map[asset.surface.triangles])] = reading.labels
    for part, confidence in reading.confidence.items():
        sure[codes == PART_NAMES.index(part)] = confidence
    return MemberReading(reading.noun, dict(reading.probabilities), codes, sure)


def agreed_nouns(readings: Sequence[MemberReading]) -> list[str]:
    """Return what each member of a collection is by the readings of all; empty where nothing is known of it."""
    total: Counter[str] = Counter()
    for each in readings:
        total.update(each.probabilities)
    firsts = Counter(each.noun for each in readings if each.noun)
    known = max(sum(firsts.values()), 1)
    if max(firsts.values(), default=0) >= _OF_MOST * known:
        common = total.most_common(1)[0][0]
        return [common if each.noun and total[each.noun] < _BELIEVED * known else each.noun for each in readings]
    groups: Counter[str] = Counter()
    for noun, share in total.items():
        groups[_group(noun)] += share
    alike = {noun: share for noun, share in total.items() if _group(noun) == max(groups, key=lambda each: groups[each])}
    return [_among(each, alike) for each in readings]


def _among(reading: MemberReading, alike: Mapping[str, float]) -> str:
    """Return what a member of a kit is; `alike` are the nouns of one kind with most of it, and how many are each."""
    sure = _SURE if reading.noun in alike else _VERY_SURE
    likely = {noun: share * alike[noun] for noun, share in reading.probabilities.items() if noun in alike}
    if not likely or reading.probabilities.get(reading.noun, 0.0) >= sure:
        return reading.noun
    return max(likely, key=lambda noun: likely[noun])


def _group(noun: str) -> str:
    return TABLE[noun].group if noun in TABLE else ""


def named_parts(codes: NDArray[np.int64]) -> list[int]:
    """Return the places in `PART_NAMES` of the parts that enough members have, by the codes (T, P) of their samples."""
    counts = {int(code): (codes == code).mean(1) for code in np.unique(codes[codes >= 0])}
    there = {code: share for code, share in counts.items() if (share > 0).mean() >= _FEWEST}
    large = {code: float(share.mean()) for code, share in there.items() if share[share > 0].mean() >= _LEAST_AREA}
    return sorted(sorted(large, key=lambda code: -large[code])[:_MOST_PARTS])
