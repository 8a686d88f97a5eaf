"""Prompts that describe what the asset is already: a change of it, or a part that is missing, and no guidance."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.assets import Limits
from meshdeform.errors import PartNotFoundError
from meshdeform.geometry.shapes import join
from meshdeform.priors.builtin.vocabulary import ADJECTIVES, NOUNS, PARTS
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import JobRun, job_input
from meshdeform.runs.changes import asked_changes, check_parts, is_change
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.runs.verdict import Recognition
from meshdeform.settings import Settings
from tests.cases import each_case
from tests.unit.plain.shapes import dog, plain_glb

DOG = plain_glb(join(*dog().values()))
EARS, GERMAN = "an elephant with big ears", "ein Elefant mit großen Ohren"


def started(prompt: str, **params: object) -> JobRun:
    request = JobRequest.model_validate({"prompt": prompt, "params": grouped(params)})
    return text_deform.start(job_input(DOG, "asset.glb", request))


def taken_for(monkeypatch: pytest.MonkeyPatch, noun: str, probability: float) -> None:
    found = Recognition(noun, probability, {noun: probability})
    monkeypatch.setattr(text_deform, "recognise", lambda *_: found)


@each_case("prompt", [EARS, GERMAN])
def test_a_part_that_is_missing_is_refused_where_the_request_says_what_the_asset_is(prompt: str) -> None:
    with pytest.raises(PartNotFoundError) as caught:
        started(prompt, source_noun="elephant")
    assert "legs" in caught.value.extra["parts"]
    assert "source_noun" not in caught.value.advice_text


def test_it_is_refused_before_the_job_where_the_request_says_so(tmp_path: Path) -> None:
    path = tmp_path / "elephant.glb"
    path.write_bytes(DOG)
    for noun, refused in {"elephant": True, "dog": False, None: False}.items():
        request = JobRequest.model_validate({"prompt": EARS, "params": grouped({"source_noun": noun} if noun else {})})
        params = TEXT_DEFORM.check(request, Settings(), frozenset({"asset"}))
        if refused:
            with pytest.raises(PartNotFoundError):
                check_parts(path, path.name, EARS, params, Limits())
        else:
            check_parts(path, path.name, EARS, params, Limits())


def test_a_part_that_is_missing_is_refused_where_the_asset_looks_like_what_it_is_called(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken_for(monkeypatch, "elephant", 0.55)
    with pytest.raises(PartNotFoundError) as caught:
        started(EARS)
    assert "taken for an elephant" in caught.value.advice_text
    assert "source_noun" in caught.value.advice_text
    taken_for(monkeypatch, "elephant", 1.0)
    with pytest.raises(RuntimeError, match="no function to load the prior"):  # a prompt like any other
        started("a camel with big humps")


@each_case(
    ("source", "called", "sure"),
    [
        (Recognition("dog", 0.96), "", False),
        (Recognition("dog", 0.97), "", True),
        (Recognition("dog", 0.96), "horse", False),
        (Recognition("dog", 0.5), "dog", True),
        (Recognition("dog", 0.49), "dog", False),
        (Recognition("", 0.0), "", False),
    ],
)
def test_what_the_prompt_calls_an_asset_counts_too(source: Recognition, called: str, sure: bool) -> None:
    assert Recognition(source.noun, source.probability, called=called).sure is sure


def test_every_prompt_with_attributes_describes_changes() -> None:
    params = resolve(DeformParams())
    for noun, parts in NOUNS.items():
        named = [(f"a {noun} with {degree} {part}", False) for part in parts for degree in PARTS[part]]
        for prompt, whole in [*named, *((f"a {word} {noun}", True) for word in ADJECTIVES)]:
            sentence = asked_changes(prompt, params)
            assert sentence is not None, prompt
            assert (sentence.noun, is_change(sentence)) == (noun, False), prompt
            assert [each.part == "whole" for each in sentence.changes] == [whole], prompt


def test_a_word_that_is_a_noun_and_a_part_is_what_the_sentence_makes_of_it() -> None:
    params = resolve(DeformParams())
    found = {
        prompt: asked_changes(prompt, params) for prompt in ("a tall door", "a wider door", "a wide seat", "a door")
    }
    assert {prompt: each and (each.noun, each.changes[0].part) for prompt, each in found.items()} == {
        "a tall door": ("door", "whole"),
        "a wider door": (None, "door"),
        "a wide seat": (None, "seat"),
        "a door": None,
    }
