"""The models in words: what is said about them is true."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.priors import catalogue
from meshdeform.priors.builtin.grammar import ATTRIBUTES, MAX_ATTRIBUTES, NOUNS, parse
from meshdeform.priors.catalogue import EXAMPLES, list_models
from tests.cases import each_case


def test_the_builtin_model_is_there_and_says_all_that_it_understands() -> None:
    (model,) = list_models("builtin")
    assert (model.id, model.available, model.problem) == ("builtin", True, None)
    assert model.vocabulary is not None
    assert set(model.vocabulary.nouns) == set(NOUNS)
    for noun in model.vocabulary.nouns:
        assert parse(f"a {noun}").noun == noun
        for part in model.vocabulary.parts[noun]:
            assert [a for a in model.vocabulary.attributes if a.endswith(f" {part}")], (noun, part)
    for text, attribute in zip(model.vocabulary.attributes, ATTRIBUTES, strict=True):
        noun = next(noun for noun in NOUNS if attribute.part in ("whole", *NOUNS[noun]))
        prompt = f"a {text} {noun}" if attribute.part == "whole" else f"a {noun} with a {text}"
        assert parse(prompt).attributes == (attribute,)


@each_case("prompt", EXAMPLES)
def test_every_example_is_understood(prompt: str) -> None:
    found = parse(prompt)
    assert str(found) == prompt
    assert len(found.attributes) <= MAX_ATTRIBUTES


def test_the_default_comes_first_and_each_model_once() -> None:
    found = list_models("owner/one", ["owner/two", "builtin", "owner/one"])
    assert [model.id for model in found] == ["owner/one", "builtin", "owner/two"]
    assert [model.title for model in found] == ["one", "Builtin", "two"]


def test_a_model_that_is_not_there_says_why() -> None:
    model = list_models("/nowhere/sd21/")[0]
    assert (model.title, model.available, model.vocabulary) == ("sd21", False, None)
    assert model.problem is not None
    assert "/nowhere/sd21" in model.problem or "diffusers" in model.problem


def test_a_folder_has_the_licence_that_its_card_states(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("---\nlicense: mit\n---\nA model.")
    builtin, model = list_models("builtin", [str(tmp_path)])
    assert (builtin.licence, model.licence) == ("Apache-2.0", "mit")


def test_where_no_model_could_run_nothing_is_claimed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue.importlib.util, "find_spec", lambda name: None)
    model = list_models("owner/one")[0]
    assert (model.available, model.problem) == (None, None)
