"""Find the parts of an asset as the product does: alone, or with noun and front given."""

from __future__ import annotations

import resource
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from bench.parts.assets import Listed
from meshdeform.assets import load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.nouns.solids import PART_NAMES
from meshdeform.plain.body import Body, loose_body
from meshdeform.plain.evidence import read_body
from meshdeform.plain.naming import find_parts
from meshdeform.plain.reader import Reader
from meshdeform.reading import Reading
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.changes import asked_changes
from meshdeform.runs.recognition import recognise

_PROPOSED = 5


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
    """Read an asset; `given`: noun and front are; `labels`: return those of the reading, not what users are shown."""
    body = loose_body(load_asset(path.read_bytes(), path.name))
    start = time.process_time()
    nouns = {each.noun: 1.0} if given else proposed(body)
    reading = read_body(body, nouns, each.front if given else None)
    parts = _labelled(reading) if labels else _listed(replace(body, reader=Reader(lambda: reading)))
    seconds = time.process_time() - start
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    ranked = sorted(reading.probabilities, key=lambda noun: -reading.probabilities[noun])
    return Found(body, reading, ranked, parts, seconds, most)


def proposed(body: Body) -> Mapping[str, float]:
    """Return the nouns that a body may be, as the judge says, with their probabilities."""
    mesh = TriangleMesh(torch.from_numpy(body.points), torch.from_numpy(body.faces))
    recognition = recognise(mesh, None, [joint.name for joint in body.joints])
    if recognition.probability == 1.0:
        return {recognition.noun: 1.0}
    return dict(sorted(recognition.nouns.items(), key=lambda item: -item[1])[:_PROPOSED])


def _labelled(reading: Reading) -> dict[str, NDArray[np.bool_]]:
    return {PART_NAMES[number]: reading.labels == number for number in np.unique(reading.labels) if number >= 0}


def _listed(body: Body) -> dict[str, NDArray[np.bool_]]:
    """Return the parts that are listed for an empty prompt."""
    read = partial(asked_changes, params=resolve(DeformParams()))
    return {part.name: part.inside for part in find_parts(body, read)}
