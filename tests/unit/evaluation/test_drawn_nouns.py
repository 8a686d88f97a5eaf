"""The drawn nouns: their seed draws those of the list, whose assets are by authors that nothing here was made with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench.nouns.drawn import drawn, titles
from bench.nouns.grids import told
from meshdeform.nouns.families import FAMILIES
from meshdeform.vocabulary.grammar import parse

pytestmark = pytest.mark.training

BENCH = Path(__file__).parents[3] / "bench"


def _listed(path: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads((BENCH / path).read_text(encoding="utf-8"))
    return entries


def test_each_drawn_noun_has_an_asset_that_becomes_it() -> None:
    entries = _listed("nouns/drawn.json")
    assert [each["name"] for each in entries] == drawn()
    assert all(parse(each["near"]).noun == each["name"] for each in entries)
    assert len({each["sha256"] for each in entries}) == len(entries)


def test_assets_are_public_and_by_authors_of_no_other_list() -> None:
    used = [each for path in ("keep/assets.json", "nouns/members.json", "parts/assets.json") for each in _listed(path)]
    entries = _listed("nouns/drawn.json")
    assert all(each["licence"].startswith(("CC0", "CC-BY")) for each in entries)
    assert not {each["author"] for each in entries} & {each["author"] for each in used}
    assert not {each["repository"] for each in entries} & {each["repository"] for each in used}


def test_a_sphere_s_tile_has_its_noun_and_three_others() -> None:
    order = titles()
    assert sorted(noun for noun, _ in order) == drawn()
    assert [noun for noun, _ in order] != drawn()
    for noun, four in order:
        assert noun in four
        assert len(set(four)) == 4


def test_what_was_looked_at_are_nouns_and_told_is_what_was_neither_another_nor_doubted() -> None:
    looked = json.loads((BENCH / "nouns/grids.json").read_text(encoding="utf-8"))
    for look in (looked["first"], looked["again"]):
        assert {*look["another"], *look["doubted"], *look.get("nouns", ())} <= FAMILIES.keys()
    assert {*looked["first"]["another"]} <= {*looked["again"]["nouns"]}
    assert all(0 <= number < 12 for noun in looked["members"] for number in looked["members"][noun])
    assert told({"another": {"cat": "dog"}, "doubted": ["cow"]}, ["cat", "cow", "pig"]) == ["pig"]
