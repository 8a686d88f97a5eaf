"""Read the source of a run with the help of its prompt: who asks for a rhino's long horns has sent a rhino."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meshdeform.exemplar.clay import is_clay
from meshdeform.exemplar.shapes import Shape
from meshdeform.plain.body import Body
from meshdeform.plain.reader import Reader
from meshdeform.requests.choices import OrientationMode
from meshdeform.requests.parameters import TARGET_FIELDS
from meshdeform.runs.base import RunInput
from meshdeform.runs.facts import AssetFacts
from meshdeform.runs.plain_change import source_body
from meshdeform.vocabulary.grammar import ParsedPrompt, parse
from meshdeform.vocabulary.solids import part_label

__all__ = ["believed_source", "is_described"]

_AS_PROBABLE = 0.2
"""Share of the probability of the noun that was read, from which the asset is the one that the prompt describes: most
prompts with attributes are of what the asset is, and of the others the noun has next to none."""

_LEAST = 0.08
"""Probability of its noun from which an asset is what a prompt describes: of the 20 `tuned` assets of `bench/keep` that
their prompts describe, 19 are more likely than that to be it, the least with 0.098."""


def believed_source(facts: AssetFacts, job_input: RunInput, verts: NDArray[np.float64] | None = None) -> Body:
    """Return the source of a run, read: as what the prompt describes, if it may be that and has the parts.

    `verts` (V, 3) float64: where the welded vertices are, if not at rest.
    """
    facts = _as_turned(facts)
    body = source_body(facts, job_input.readings, verts)
    asked, reading = _described(facts, job_input), body.reader.reading
    if asked is None or reading is None or reading.noun == asked.noun:
        return body
    if reading.probabilities.get(asked.noun, 0.0) < _AS_PROBABLE * reading.probability:
        return body
    named = replace(facts, params=facts.params.model_copy(update={"source_noun": asked.noun}))
    other = source_body(named, job_input.readings, verts)
    described = other.reader.reading
    parts = {part_label(each.part) for each in asked.attributes if each.part != "whole"}
    if described is None or not parts <= set(described.parts):
        return body
    return replace(other, reader=Reader(lambda: replace(described, probabilities=reading.probabilities)))


def is_described(body: Body, noun: str | None) -> bool:
    """Return whether a source, as `believed_source` returns it, is what a prompt describes, so that it is changed.

    `noun`: that of the prompt. Clay is nothing yet, whatever it is taken for.
    """
    reading = body.reader.reading
    if reading is None or reading.noun != noun or reading.probability < _LEAST:
        return False
    return not is_clay(Shape(reading.noun, body.points, body.faces, reading.labels))


def _described(facts: AssetFacts, job_input: RunInput) -> ParsedPrompt | None:
    """Return the only prompt if it tells attributes of its noun; None if it does not, or the source's is given."""
    if facts.params.source_noun is not None or facts.params.prompts or any(n in job_input.files for n in TARGET_FIELDS):
        return None
    asked = parse(facts.request.prompt)
    return asked if asked.attributes else None


def _as_turned(facts: AssetFacts) -> AssetFacts:
    """Return facts with the front that `keep` means, +Z, which a reading takes for none."""
    if facts.params.orientation is not OrientationMode.KEEP:
        return facts
    return replace(facts, params=facts.params.model_copy(update={"orientation": 0.0}))
