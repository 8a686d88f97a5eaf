"""Find the parts of an asset as the product does: alone, or with noun and front given."""

from __future__ import annotations

import resource
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.parts.assets import Listed
from meshdeform.assets import load_asset
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.naming import find_parts
from meshdeform.reading import Reading
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.runs.changes import asked_changes
from meshdeform.runs.reading import ReadingSource, corrected
from meshdeform.vocabulary.solids import PART_NAMES


@dataclass(frozen=True)
class Found:
    """What was found on an asset, and what it took."""

    body: Body
    reading: Reading
    nouns: list[str]  # the likeliest first
    parts: Mapping[str, NDArray[np.bool_]]  # mapping of str to (F,) bool
    seconds: float  # of one core
    megabytes: float  # the most that this process has ever held


def found(each: Listed, path: Path, *, given: bool, labels: bool = False) -> Found:
    """Read an asset; `given`: noun and front are; `labels`: return those of the reading, not what users are shown.

    Raises ValueError: it cannot be read.
    """
    asset, params = load_asset(path.read_bytes(), path.name), said(each, given=given)
    loose = loose_body(asset)
    start = time.process_time()
    body = corrected(loose, asset, params, ReadingSource("", path.name))
    reading = body.reader.reading
    if reading is None:
        raise ValueError("it cannot be read")
    parts = _labelled(reading) if labels else _listed(body, params)
    seconds = time.process_time() - start
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    ranked = sorted(reading.probabilities, key=lambda noun: -reading.probabilities[noun])
    return Found(body, reading, ranked, parts, seconds, most)


def said(each: Listed, *, given: bool) -> ResolvedParams:
    """Return the parameters of a request; `given`: it says what the asset is, and where its front is."""
    front = {} if each.front is None else {"orientation": each.front}
    return resolve(DeformParams.model_validate({"guidance": {"source_noun": each.noun, **front}} if given else {}))


def _labelled(reading: Reading) -> dict[str, NDArray[np.bool_]]:
    return {PART_NAMES[number]: reading.labels == number for number in np.unique(reading.labels) if number >= 0}


def _listed(body: Body, params: ResolvedParams) -> dict[str, NDArray[np.bool_]]:
    """Return the parts that are listed for an empty prompt."""
    return {part.name: part.inside for part in find_parts(body, partial(asked_changes, params=params))}
