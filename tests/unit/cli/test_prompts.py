"""`--also`: what is typed is what the request has, and what comes of it is said for each prompt."""

from __future__ import annotations

import pytest
import typer

from meshdeform.cli.report_lines import prompt_lines
from meshdeform.cli.request import read_prompt
from meshdeform.requests.document import DeformParams
from tests.cases import each_case


def test_further_prompts_are_written_with_weight_and_place() -> None:
    written = ["a rabbit", "a rabbit: .5", " a 2:1 box:2@node=Head@box=0,0,0,1,1,1", "a horse@outside:material=3"]
    parsed = [read_prompt(text) for text in written]
    box = {"box": {"min": [0, 0, 0], "max": [1, 1, 1]}}
    assert parsed == [
        {"prompt": "a rabbit"},
        {"prompt": "a rabbit", "weight": 0.5},
        {"prompt": "a 2:1 box", "weight": 2.0, "regions": [{"node": "Head"}, box]},
        {"prompt": "a horse", "regions": [{"material": 3}], "outside": True},
    ]
    assert len(DeformParams.model_validate({"guidance": {"prompts": parsed}}).prompts) == 4


@each_case("text", ["", "@node=a", "a vase@", "a vase@head", "a vase@node=a@outside:node=b"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(typer.BadParameter):
        read_prompt(text)


def test_each_prompt_gets_a_line() -> None:
    like = {"noun": "bell", "probability": 0.6, "rank": 1, "nouns": 122, "matches": True}
    like["next"] = {"noun": "owl", "probability": 0.2}
    found = [
        {"prompt": "a bell", "regions": [], "likeness": like},
        {"prompt": "a vase", "regions": [], "likeness": None},
        {"prompt": "an old bell", "regions": [{"node": "Head"}], "likeness": like},
        {"prompt": "a bell", "regions": [{"node": "Head"}], "likeness": {**like, "before": {"probability": 0.002}}},
    ]
    looks = "Looks like: a bell (60% among the judge's 122 nouns); next: an owl (20%)"
    assert prompt_lines(found) == [
        f"a bell: {looks}",
        f"an old bell (in its region): {looks}",
        f"a bell (in its region, under 1% before): {looks}",
    ]
