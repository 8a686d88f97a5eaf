"""The suite of real assets: its list, the order of its sheets, and what its grades come to."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.keep.assets import DISTANCES, SPLITS, group_of, listed, pairs
from bench.keep.blind import NOTHING, shuffled
from bench.keep.cost import split, write_dog
from bench.keep.grades import Row, by_group, by_verdict, parsed, read, saved, share, table
from bench.keep.runs import CHILD, command, verdict
from meshdeform.vocabulary.grammar import parse
from meshdeform.vocabulary.nouns import NOUN_GROUPS, NOUNS

pytestmark = pytest.mark.training


class TestList:
    def test_splits(self) -> None:
        assert len(listed("tuned")) == 52
        assert len(listed("last")) == 20
        assert len(listed("fresh")) == 24
        assert len({each.name for each in listed()}) == len({each.sha256 for each in listed()}) == 96

    @pytest.mark.parametrize("pair", pairs(), ids=lambda pair: pair.name)
    def test_prompts(self, pair: Any) -> None:
        assert parse(pair.prompt).noun in NOUNS
        assert pair.asset.noun in NOUNS
        assert parse(pair.asset.near) != parse(pair.asset.far)

    def test_far_is_another_noun(self) -> None:
        assert all(parse(each.far).noun != each.noun for each in listed())

    @pytest.mark.parametrize("split", SPLITS[1:])
    def test_repositories_and_authors_were_not_used_before(self, split: str) -> None:
        before = [each for name in SPLITS[: SPLITS.index(split)] for each in listed(name)]
        assert not {each.repository for each in before} & {each.repository for each in listed(split)}
        assert not {each.author for each in before} & {each.author for each in listed(split)} - {"not stated"}

    def test_fresh_ask_for_nouns_of_the_same_group(self) -> None:
        assert all(pair.asset.noun in NOUN_GROUPS[group_of(pair.prompt)] for pair in pairs("fresh"))

    def test_pairs_of_a_group(self) -> None:
        chosen = pairs("tuned", groups=["vehicles"])
        assert {"van-near", "PineTree_1-far"} < {pair.name for pair in chosen}
        assert all(parse(pair.prompt).noun in NOUN_GROUPS["vehicles"] for pair in chosen)

    def test_the_latest_split_is_run_first(self) -> None:
        assert [each.asset.split for each in pairs()] == ["fresh"] * 48 + ["last"] * 40 + ["tuned"] * 104
        assert [each.distance for each in pairs(names=["a_bear"])] == list(DISTANCES)


def record(asset: str, distance: str, value: str | None) -> dict[str, Any]:
    report = None if value is None else {"verdict": {"value": value}}
    return {"asset": asset, "split": SPLITS[0], "distance": distance, "prompt": "a cow", "report": report}


RUNS = {
    name: {f"{asset}-{distance}": record(asset, distance, value) for asset in ("one", "two") for distance in DISTANCES}
    for name, value in (("old", "good"), ("new", "keep_source"))
}


class TestOrder:
    def test_every_result_and_doing_nothing_once(self) -> None:
        rows = shuffled(RUNS, 1)
        assert len(rows) == 12
        expected = set(product(("old", "new", NOTHING), ("one", "two"), DISTANCES))
        assert {(row.run, row.asset, row.distance) for row in rows} == expected

    def test_seed_alone_decides(self) -> None:
        backwards = {name: dict(reversed(records.items())) for name, records in reversed(RUNS.items())}
        assert shuffled(RUNS, 5) == shuffled(backwards, 5)
        assert shuffled(RUNS, 5) != shuffled(RUNS, 6)

    def test_doing_nothing_has_no_verdict_of_its_own(self) -> None:
        assert {row.verdict for row in shuffled(RUNS, 1) if row.run == NOTHING} == {"none"}


class TestVerdict:
    @pytest.mark.parametrize(
        ("value", "expected"),
        [("good", "good"), ("keep_source", "keep_source"), ("keep_result", "doubtful"), (None, "failed")],
    )
    def test_words(self, value: str | None, expected: str) -> None:
        assert verdict(record("one", "near", value)) == expected


class TestGrades:
    def test_lines(self) -> None:
        assert parsed("2 5 4 3 the ears are webbed\n\n1 0 5 0\n", 2) == {2: (5, 4, 3), 1: (0, 5, 0)}

    @pytest.mark.parametrize("text", ["3 1 1 1", "0 1 1 1", "1 1 1 1\n1 1 1 1", "1 6 1 1", "1 1 1", "one 1 1 1"])
    def test_other_lines_are_refused(self, text: str) -> None:
        with pytest.raises(ValueError):
            parsed(text, 2)

    def test_table(self) -> None:
        rows = [
            Row("new", "one", "last", "near", "a cow", "good", (5, 4, 3)),
            Row("new", "two", "last", "near", "a cow", "doubtful", (3, 4, 2)),
            Row("new", "one", "last", "far", "a boat", "keep_source", (4, 3, 5)),
            Row("new", "two", "last", "far", "a boat", "failed"),
            Row("new", "six", "last", "far", "a boat", "good"),
        ]
        assert table(rows).splitlines()[2:] == [
            "| new | last | near | 2 | 4.0 | 4.0 | 2.5 | 50% | 0 | 0 |",
            "| new | last | far | 1 | 4.0 | 3.0 | 5.0 | 0% | 1 | 1 |",
            "| new | last | both | 3 | 4.0 | 3.7 | 3.3 | 25% | 1 | 1 |",
        ]

    def test_table_by_group(self) -> None:
        rows = [
            Row("new", "one", "last", "near", "a cow", "good", (5, 4, 3)),
            Row("new", "two", "last", "near", "a fat pig", "failed"),
            Row("new", "six", "last", "far", "a boat", "good"),
            Row("old", "one", "last", "near", "a cow", "good", (5, 4, 2)),
        ]
        assert by_group(rows).splitlines() == [
            "| prompts for | new | old |",
            "|---|---|---|",
            "| animals | 1 of 2 | 0 of 1 |",
        ]

    def test_table_by_verdict(self) -> None:
        verdicts = [("good", 3), ("good", 2), ("doubtful", 4), ("keep_source", 1), ("none", 5)]
        rows = [
            Row("new", str(number), "last", "near", "a cow", verdict, (5, 4, worth))
            for number, (verdict, worth) in enumerate(verdicts)
        ]
        (line,) = by_verdict([*rows, replace(rows[0], run="nothing", verdict="none")]).splitlines()[2:]
        assert line == f"| new | last | 5 | 3 | {share(1, 2)} | {share(1, 3)} | {share(1, 1)} |"
        assert share(9, 10) == "9 of 10, 90% (60% to 98%)"
        assert share(0, 0) == "-"

    def test_they_are_read_as_they_were_saved(self) -> None:
        graded = Row("new", "one", "last", "near", "a cow", "good", (5, 4, 3))
        rows = [graded, replace(graded, distance="far", verdict="failed", grade=None)]
        assert read(saved(3, {"new": "c23ea518"}, rows)) == rows


class TestCost:
    def test_kind_is_asked_for_by_name(self) -> None:
        asked = command("a cow", Path("a.glb"), Path("b.glb"), "exemplar")
        assert asked[-2:] == ["--set", "guidance.kind=exemplar"]
        assert "--set" not in command("a cow", Path("a.glb"), Path("b.glb"), None)

    def test_split_keeps_the_surface(self) -> None:
        verts, faces = split(np.eye(3), np.array([[0, 1, 2]]))
        assert verts.shape == (6, 3)
        a, b, c = verts[faces].transpose(1, 0, 2)
        crosses = np.cross(b - a, c - a)
        np.testing.assert_allclose(crosses, np.full((4, 3), 0.25), atol=1e-15)

    def test_dog_has_about_so_many_faces(self, tmp_path: Path) -> None:
        assert abs(write_dog(tmp_path / "dog.obj", 1000) - 1000) <= 20

    def test_memory_of_a_command_is_its_own(self) -> None:
        held = np.ones(40_000_000)  # 320 MB, which a process started from here would be said to hold
        done = subprocess.run([sys.executable, "-I", str(CHILD), sys.executable, "-c", "pass"], capture_output=True)
        used = json.loads(done.stdout)
        assert held.all()
        assert used["exit"] == 0
        assert used["megabytes"] < 100
