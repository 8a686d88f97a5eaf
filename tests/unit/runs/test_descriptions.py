"""Prompts that describe what the asset is already: a change of it, or a part that is missing, and no guidance."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshdeform.assets import Limits, load_asset
from meshdeform.errors import PartNotFoundError
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.plain.body import loose_body
from meshdeform.plain.reader import Reader
from meshdeform.reading import NO_PART, Reading
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.requests.groups import grouped
from meshdeform.runs import reading, text_deform
from meshdeform.runs.base import JobFile, JobRun, job_input
from meshdeform.runs.believed import is_described
from meshdeform.runs.changes import asked_changes, check_parts, is_change
from meshdeform.runs.text_deform_kind import TEXT_DEFORM
from meshdeform.settings import Settings
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from meshdeform.vocabulary.solids import PART_NAMES
from meshdeform.vocabulary.words import ADJECTIVES
from tests.cases import each_case
from tests.unit.plain.shapes import dog, plain_glb

DOG = plain_glb(join(*dog().values()))
EARS, GERMAN = "an elephant with big ears", "ein Elefant mit großen Ohren"


def started(prompt: str, **params: object) -> JobRun:
    request = JobRequest.model_validate({"prompt": prompt, "params": grouped(params)})
    return text_deform.start(job_input(DOG, "asset.glb", request))


def read_as(monkeypatch: pytest.MonkeyPatch, noun: str, probability: float, **others: float) -> None:
    """Let the asset be read as a noun."""
    body = loose_body(load_asset(DOG))
    labels = np.where(body.points[body.faces].mean(1)[:, 1] > 2.2, PART_NAMES.index("head"), PART_NAMES.index("body"))
    found = Reading(noun, {noun: probability, **others}, np.eye(3), 0.5, labels, {"head": 0.8, "body": 0.9}, 0, 0.01)
    monkeypatch.setattr(reading, "read_source", lambda *_: found)


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
        params = TEXT_DEFORM.check(request, Settings(), {"asset": JobFile()})
        if refused:
            with pytest.raises(PartNotFoundError):
                check_parts(path, path.name, EARS, params, Limits())
        else:
            check_parts(path, path.name, EARS, params, Limits())


def test_what_it_is_read_as_decides_and_is_in_the_report(monkeypatch: pytest.MonkeyPatch) -> None:
    read_as(monkeypatch, "dog", 0.55, fox=0.3)
    run = started("a dog with a big head")
    report = json.loads(run.finish()["report.json"].data)
    assert report["way"] == "change"
    assert report["source_noun"] == {"noun": "dog", "probability": 0.55, "recognised": True}
    assert [each["noun"] for each in report["reading"]["nouns"]] == ["dog", "fox"]
    assert (report["reading"]["parts"], report["reading"]["sure"]) == ({"head": 0.8, "body": 0.9}, False)
    assert report["changes"][0]["found_by"] == "shapes"
    with pytest.raises(PartNotFoundError) as caught:
        started("a dog with big ears")
    assert "taken for a dog" in caught.value.advice_text
    assert "source_noun" in caught.value.advice_text
    with pytest.raises(RuntimeError, match="no function to load the prior"):  # a prompt like any other
        started("a horse with a big head")
    assert not any("counts as" in warning for warning in report["warnings"])
    read_as(monkeypatch, "dog", 0.3, fox=0.2)
    unlikely = json.loads(started("a dog with a big head").finish()["report.json"].data)
    assert "counts as a dog, as the prompt describes it" in unlikely["warnings"][0]
    assert unlikely["verdict"]["value"] == "doubtful"
    assert "30% likely" in unlikely["warnings"][0]
    taller = json.loads(started("taller").finish()["report.json"].data)
    assert taller["reading"] is None


@each_case(
    ("lump", "noun", "probability", "described"),
    [
        (False, "dog", 0.2, True),
        (False, "dog", 0.07, False),
        (False, "horse", 1.0, False),
        (False, None, 1.0, False),
        (True, "dog", 1.0, False),  # clay is to be shaped, whatever it is taken for
    ],
)
def test_a_prompt_describes_what_the_asset_likely_is(
    lump: bool, noun: str | None, probability: float, described: bool
) -> None:
    body = loose_body(load_asset(plain_glb(icosphere(2)) if lump else DOG))
    labels = np.full(len(body.faces), NO_PART)
    found = Reading("dog", {"dog": probability}, np.eye(3), 0.5, labels, {}, 0, 0.01)
    assert is_described(replace(body, reader=Reader(lambda: found)), noun) is described
    assert not is_described(body, noun)


def test_a_ball_that_is_asked_for_a_tall_vase_is_moulded_into_one() -> None:
    heights = {}
    for prompt in ("a tall vase", "a vase"):
        params = grouped({"guidance": "exemplar", "source_noun": "vase"})
        request = JobRequest.model_validate({"prompt": prompt, "params": params})
        run = text_deform.start(job_input(plain_glb(icosphere(2)), "asset.glb", request))
        assert len(list(run)) > 0
        files = run.finish()
        report = json.loads(files["report.json"].data)
        assert (report["way"], report["exemplars"][0]["member"]["way"]) == ("exemplar", "mould")
        size = np.ptp(load_asset(files["result.glb"].data).surface.positions, axis=0)
        heights[prompt] = size[1] / max(size[0], size[2])
    assert heights["a tall vase"] > 1.1 * heights["a vase"]


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
