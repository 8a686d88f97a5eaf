"""When a result is worse than its source, and what the report says of it."""

from __future__ import annotations

from typing import Any

import pytest

from meshdeform.cli.report_lines import kept_line, verdict_line
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure, measure_structure
from meshdeform.geometry.shapes import icosphere
from meshdeform.runs.verdict import kept_structure, verdict, worse_than_source
from tests.cases import each_case

GOOD = {"asymmetry": 0.0, "flatness": None, "contacts": 0.0, "cut_share": 0.0, "flipped_faces": 0}


def judged(before: int, after: int) -> dict[str, Any]:
    return {"noun": "umbrella", "rank": after, "nouns": 122, "before": {"rank": before}}


@each_case(
    "ranks, change, worse",
    [
        ((5, 5), {}, False),
        ((5, 5), {"asymmetry": 0.02}, True),
        ((5, 2), {"asymmetry": 0.02}, False),
        ((5, 6), {"flipped_faces": 1}, True),
        ((5, 6), {"asymmetry": None, "contacts": None}, False),
        ((1, 1), {}, False),
        ((1, 1), {"contacts": 0.01}, True),
    ],
)
def test_a_result_is_worse_if_it_gained_nothing_and_lost_structure(
    ranks: tuple[int, int], change: dict[str, Any], worse: bool
) -> None:
    structure = {**GOOD, **change}
    assert worse_than_source(*ranks, structure) is worse
    said = verdict("an umbrella", judged(*ranks), structure)
    assert said["value"] == ("keep_source" if worse else "keep_result")
    assert bool(said["reasons"]) is worse
    assert said["structure"] == structure


def test_the_reasons_are_sentences() -> None:
    said = verdict("an umbrella", judged(5, 7), {**GOOD, "asymmetry": 0.031, "flipped_faces": 1200})
    assert said["reasons"] == [
        "It looks no more like an umbrella than before: rank 7 of 122 nouns, was 5.",
        "Mirror symmetry was lost: 3.1% of the diagonal.",
        "Faces were flipped: 1,200.",
    ]
    assert verdict_line(said).startswith("Verdict: keep your asset as it is (keep_source). It looks no more like")
    already = verdict("an umbrella", judged(1, 1), {**GOOD, "cut_share": 0.02})
    assert already["reasons"] == [
        "The source looked like an umbrella already.",
        "Faces newly cut others: 2.0% of all.",
    ]
    assert verdict_line(verdict("an umbrella", judged(5, 1), GOOD)) == ""
    assert kept_line({"kept_share": 0.917}) == "Still your asset: 92% of the surface kept its shape"


@each_case("prompt, value", [("a tree", "keep_source"), ("a tall twisted tree", "keep_result")])
def test_what_is_asked_to_be_crooked_need_not_be_symmetric_or_flat(prompt: str, value: str) -> None:
    assert verdict(prompt, judged(1, 2), {**GOOD, "asymmetry": 0.1, "flatness": 0.1})["value"] == value
    assert verdict(prompt, judged(1, 2), {**GOOD, "flipped_faces": 1})["value"] == "keep_source"


@each_case(
    "prompt, ranks, value",
    [
        ("an umbrella", (5, 3), "keep_source"),
        ("an umbrella", (4, 2), "keep_result"),
        ("an umbrella", (1, 1), "keep_source"),
        ("a tall umbrella", (2, 2), "keep_result"),
        ("a tall umbrella", (2, 3), "keep_source"),
    ],
)
def test_a_rank_is_gained_if_it_halves_and_with_attributes_if_it_is_not_lost(
    prompt: str, ranks: tuple[int, int], value: str
) -> None:
    said = verdict(prompt, judged(*ranks), {**GOOD, "flipped_faces": 1})
    assert said["value"] == value
    if ranks == (5, 3):
        assert said["reasons"][0] == "It looks hardly more like an umbrella than before: rank 3 of 122 nouns, was 5."


def test_what_was_kept_is_measured_on_the_shapes() -> None:
    ball = icosphere(3)
    verts = ball.verts.clone()
    verts[0] *= -1.5
    result = TriangleMesh(verts, ball.faces)
    quality = measure(ball.verts.numpy(), ball.faces.numpy(), verts.numpy()).to_dict()
    assert kept_structure(ball, ball, {**quality, "self_intersections_added": None})["cut_share"] == 0
    structure = kept_structure(ball, result, quality)
    assert structure["cut_share"] == pytest.approx(quality["self_intersections_added"] / len(ball.faces))
    assert structure["cut_share"] > 0
    assert structure["flipped_faces"] == quality["flipped_faces"]
    assert structure.items() >= measure_structure(ball, result).to_dict().items()
