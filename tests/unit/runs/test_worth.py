"""What a result is worth: good, doubtful, or less than its source; why, and what may help."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from meshdeform.cli.report_lines import kept_line, verdict_line
from meshdeform.runs.kept_structure import LIMITS
from meshdeform.runs.worth import (
    ShapeFigures,
    SourceAsset,
    of_exemplars,
    of_noun,
    of_pictures,
    of_prompts,
    of_shape,
    of_shape_alone,
    of_target,
    verdict_of_change,
    worst,
)
from meshdeform.verdicts import Verdict, read_verdict
from tests.cases import each_case

STRUCTURE: dict[str, Any] = {
    "asymmetry": 0.0,
    "flatness": None,
    "contacts": 0.0,
    "components": 1,
    "cut_share": 0.0,
    "flipped_faces": 0,
}
WHOLE = ShapeFigures(STRUCTURE, swollen=False, held=0.0, moved=0.1)
GOOD, DOUBTFUL, KEEP_SOURCE = "good", "doubtful", "keep_source"


def judged(after: float, rank: int = 1, before: float = 0.0, was: int = 9) -> dict[str, Any]:
    return {
        "noun": "umbrella",
        "probability": after,
        "rank": rank,
        "nouns": 474,
        "next": {"noun": "mushroom", "probability": 0.1},
        "before": {"probability": before, "rank": was},
    }


def shaped(**changes: Any) -> ShapeFigures:
    own = {name: changes.pop(name) for name in ("swollen", "held", "moved") if name in changes}
    return replace(WHOLE, structure={**STRUCTURE, **changes}, **own)


@each_case(
    "prompt, likeness, changes, value",
    [
        # It is good if it shows its noun, which the source did not, and is whole.
        ("an umbrella", judged(0.5), {}, GOOD),
        ("an umbrella", judged(0.49), {}, DOUBTFUL),
        ("an umbrella", judged(0.9, before=0.49, was=1), {}, GOOD),
        ("an umbrella", judged(0.9, before=0.5, was=1), {}, DOUBTFUL),
        ("a tall umbrella", judged(1.0, before=1.0, was=1), {}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"swollen": True}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"held": 0.2}, GOOD),
        ("an umbrella", judged(0.9), {"held": 0.21}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"flatness": 0.02}, GOOD),
        ("an umbrella", judged(0.9), {"flatness": 0.021}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"asymmetry": 0.02}, GOOD),
        ("an umbrella", judged(0.9), {"asymmetry": 0.021}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"contacts": 0.01}, GOOD),
        ("an umbrella", judged(0.9), {"contacts": 0.011}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"cut_share": 0.15}, GOOD),
        ("an umbrella", judged(0.9), {"cut_share": 0.16}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"opened_junctions": 1}, DOUBTFUL),
        ("an umbrella", judged(0.9), {"opened_junctions": None}, GOOD),
        ("an umbrella", judged(0.1, 5), {"opened_junctions": 1}, KEEP_SOURCE),
        ("an umbrella", judged(0.9), {"flipped_faces": 1}, DOUBTFUL),
        # What is asked to be crooked need not be symmetric or flat.
        ("a twisted umbrella", judged(0.9), {"asymmetry": 0.1, "flatness": 0.1}, GOOD),
        ("a twisted umbrella", judged(0.9), {"asymmetry": 0.1, "flipped_faces": 1}, DOUBTFUL),
        # What does not look like its prompt is doubtful at best.
        ("an umbrella", judged(0.4, 2), {}, DOUBTFUL),
        ("an umbrella", judged(0.0, 30, was=5), {}, DOUBTFUL),
        # It is worse than the source if it gained no rank, and something broke; or if parts swelled or withered.
        ("an umbrella", judged(0.1, 5), {"flipped_faces": 1}, KEEP_SOURCE),
        ("an umbrella", judged(0.1, 4), {"flipped_faces": 1}, DOUBTFUL),
        ("an umbrella", judged(0.1, 5), {"cut_share": 0.011}, KEEP_SOURCE),
        ("an umbrella", judged(0.1, 5), {"cut_share": 0.01}, DOUBTFUL),
        ("a tall umbrella", judged(0.1, 9), {"flipped_faces": 1}, DOUBTFUL),
        ("a tall umbrella", judged(0.1, 10), {"flipped_faces": 1}, KEEP_SOURCE),
        ("an umbrella", judged(0.1, 2), {"swollen": True}, KEEP_SOURCE),
        ("an umbrella", judged(0.1, 1), {"swollen": True, "flipped_faces": 1}, DOUBTFUL),
        ("a twisted umbrella", judged(0.1, 10), {"asymmetry": 0.1}, DOUBTFUL),
    ],
)
def test_a_prompt_is_met_if_it_is_shown_and_the_shape_is_whole(
    prompt: str, likeness: dict[str, Any], changes: dict[str, Any], value: str
) -> None:
    shape = shaped(**changes)
    said = of_noun(prompt, likeness, shape)
    assert said["value"] == value
    assert said["structure"] == shape.structure
    assert said["reasons"]
    assert bool(said["advice"]) is (value != GOOD)
    assert all(text[0].isupper() and text[-1] == "." for text in said["reasons"] + said["advice"])


@each_case(
    "prompt, source, value",
    [
        ("a rabbit", SourceAsset(convex=True), GOOD),
        ("a vase", SourceAsset(round=True), GOOD),
        ("a rabbit", SourceAsset(round=True), DOUBTFUL),
        ("a vase", SourceAsset("bottle"), DOUBTFUL),
    ],
)
def test_clay_may_swell_and_bend(prompt: str, source: SourceAsset, value: str) -> None:
    assert of_noun(prompt, judged(0.9), shaped(swollen=True, flatness=0.1), source)["value"] == value
    assert of_noun(prompt, judged(0.9), shaped(flipped_faces=1), source)["value"] == DOUBTFUL


@each_case(
    "figures, fitted, swollen",
    [
        ({"area_ratio_spread": 0.7, "symmetric_dirichlet_mean": 9.0}, False, False),
        ({"area_ratio_spread": 0.71, "symmetric_dirichlet_mean": 1.0}, False, True),
        ({"area_ratio_spread": 9.0, "symmetric_dirichlet_mean": 2.0}, True, False),
        ({"area_ratio_spread": 0.0, "symmetric_dirichlet_mean": 2.01}, True, True),
    ],
)
def test_parts_swell_against_the_rest_or_beyond_what_a_target_asks(
    figures: dict[str, float], fitted: bool, swollen: bool
) -> None:
    movement = {"held_at_end": 0.3, "rms": 0.2}
    assert ShapeFigures.of(STRUCTURE, figures, movement, fitted=fitted) == ShapeFigures(STRUCTURE, swollen, 0.3, 0.2)


def test_the_reasons_and_the_advice_are_sentences() -> None:
    shape = shaped(asymmetry=0.031, flipped_faces=1200)
    said = of_noun("an umbrella", judged(0.0, 7, was=7), shape, SourceAsset("mug", sure=False))
    assert said["reasons"] == [
        "It looks no more like an umbrella than before (number 7 of 474 nouns, where the source was 7), and most like "
        "a mushroom.",
        "Mirror symmetry was lost: 3.1% of the diagonal.",
        "Faces were flipped: 1,200.",
    ]
    assert said["advice"][0] == "If your asset is not a mug, say what it is with source_noun: its front depends on it."
    assert said["advice"][1].startswith("Ask for what is nearer to a mug: some others of the vessels and tools")
    assert len(said["advice"]) == 3
    assert verdict_line(said).startswith("keep_source: It looks no more like an umbrella")
    assert verdict_line(said).endswith(said["advice"][-1])
    good = of_noun("an umbrella", judged(0.97), WHOLE)
    assert verdict_line(good) == "good: It looks like an umbrella (97%)."
    assert kept_line({"kept_share": 0.917}) == "Still your asset: 92% of the surface kept its shape"


@each_case(
    "prompt, source, likeness, advised",
    [
        ("a bus", SourceAsset("van", growth=(1.0, 1.0, 1.5)), judged(0.2, 2), "longer"),
        ("a bus", SourceAsset("van", growth=(1.5, 1.0, 1.0), long_axis=0), judged(0.2, 2), "longer"),
        ("a bus", SourceAsset("van", growth=(1.0, 1.0, 1.0)), judged(0.2, 2), "longer"),
        ("a bus", SourceAsset("van", growth=(1.0, 0.6, 1.0)), judged(0.2, 2), "shorter"),
        ("a bus", SourceAsset("van", growth=(0.6, 1.0, 1.0)), judged(0.2, 2), "narrower"),
        ("a rocket", SourceAsset("", growth=(1.0, 2.0, 1.0)), judged(0.2, 2), ""),
        ("a teapot with a long spout", SourceAsset("teapot"), judged(1.0, 1, 1.0, 1), "longer spout"),
        ("a tall twisted vase", SourceAsset("vase"), judged(1.0, 1, 1.0, 1), "taller"),
    ],
)
def test_a_change_in_plain_words_is_advised_where_it_does_as_much(
    prompt: str, source: SourceAsset, likeness: dict[str, Any], advised: str
) -> None:
    advice = of_noun(prompt, likeness, WHOLE, source)["advice"]
    changes = [
        text.split("“")[1].split("”")[0] for text in advice if text.startswith(("Ask for the change", "Say in plain"))
    ]
    assert changes == [advised] * bool(advised)


def test_of_several_prompts_one_that_pulls_at_the_whole_must_be_seen() -> None:
    region = [{"box": {}}]
    unseen, seen = {"likeness": judged(0.2, 4), "regions": []}, {"likeness": judged(0.8), "regions": []}
    assert of_prompts([unseen, seen], WHOLE)["value"] == GOOD
    assert of_prompts([{**seen, "likeness": judged(0.49)}], WHOLE)["value"] == DOUBTFUL
    said = of_prompts([unseen, {**unseen, "regions": region}], WHOLE)
    assert (said["value"], said["reasons"]) == (
        DOUBTFUL,
        ["It does not look like an umbrella. It looks most like a mushroom."],
    )
    assert of_prompts([{**unseen, "regions": region}, {"prompt": "a bus", "regions": []}], WHOLE)["value"] == GOOD
    assert of_prompts([seen], shaped(flipped_faces=1))["value"] == DOUBTFUL


def fit(left: float, within: float) -> dict[str, Any]:
    before = {"to_target": 0.05, "from_target": 0.05}
    return {name: left * distance for name, distance in before.items()} | {"within": within, "before": before}


@each_case(
    "left, within, changes, value",
    [
        (0.35, 0.67, {}, GOOD),
        (0.36, 0.9, {}, DOUBTFUL),
        (0.1, 0.66, {}, DOUBTFUL),
        (0.1, 0.9, {"flipped_faces": 1}, DOUBTFUL),
        (0.1, 0.9, {"swollen": True}, DOUBTFUL),
        (0.9, 0.2, {"swollen": True}, KEEP_SOURCE),
        (0.9, 0.2, {"flipped_faces": 1}, DOUBTFUL),
    ],
)
def test_a_target_is_met_by_the_distance_that_is_left(
    left: float, within: float, changes: dict[str, Any], value: str
) -> None:
    said = of_target(fit(left, within), shaped(**changes))
    assert said["value"] == value
    assert said["reasons"][0].startswith(f"{left:.0%} of the distance to the target is left")
    assert bool(said["advice"]) is (value != GOOD)


def test_a_target_that_the_source_is_already_is_met() -> None:
    alike = {"to_target": 2e-5, "from_target": 3e-5, "within": 1.0, "before": {"to_target": 1e-5, "from_target": 1e-5}}
    said = of_target(alike, WHOLE)
    assert said["value"] == GOOD
    assert said["reasons"][0].startswith("0% of the distance")


@each_case(
    "kept, left, distortion, value",
    [
        (1.0, 0.0, 1.0, GOOD),
        (0.9, 0.6, 1.9, GOOD),
        (0.9, None, 5.0, GOOD),
        (0.89, 0.0, 1.0, DOUBTFUL),
        (1.0, 0.61, 1.0, DOUBTFUL),
        (1.0, 0.0, 1.91, DOUBTFUL),
    ],
)
def test_a_fit_that_was_taken_back_stayed_away_or_was_stretched_is_doubtful(
    kept: float, left: float | None, distortion: float, value: str
) -> None:
    said = of_exemplars(kept, replace(WHOLE, distortion=distortion), left)
    assert said["value"] == value
    assert bool(said["advice"]) is bool(said["reasons"]) is (value == DOUBTFUL)


@each_case(
    "prompt, likeness, value",
    [
        ("an umbrella", judged(0.6, 1, was=20), GOOD),
        ("an umbrella", judged(0.3, 2, was=20), DOUBTFUL),
        ("an umbrella", judged(0.1, 15, was=15), DOUBTFUL),
        ("an umbrella", judged(0.0, 16, was=90), KEEP_SOURCE),
        ("a tall umbrella", judged(0.0, 16, was=17), KEEP_SOURCE),
    ],
)
def test_a_fit_that_is_nothing_like_its_noun_is_not_kept(prompt: str, likeness: dict[str, Any], value: str) -> None:
    assert of_noun(prompt, likeness, shaped(flatness=0.1), fitted=True)["value"] == value


@each_case("iou, value", [((0.9, 0.75), GOOD), ((0.8, 0.8), DOUBTFUL), ((0.5, 0.5), DOUBTFUL)])
def test_pictures_are_met_by_what_the_silhouettes_lack(iou: tuple[float, float], value: str) -> None:
    pictures = [{"iou_before": 0.5, "iou": each} for each in iou]
    assert of_pictures(pictures, WHOLE)["value"] == value
    assert of_pictures([{"iou_before": 1.0, "iou": 1.0}], WHOLE)["value"] == GOOD


def test_where_nobody_can_say_what_it_looks_like_the_shape_decides() -> None:
    assert of_shape(WHOLE)["value"] == GOOD
    assert of_shape(shaped(moved=0.01))["value"] == GOOD
    still = of_shape(shaped(moved=0.009))
    assert (still["value"], still["reasons"]) == (DOUBTFUL, ["It hardly moved: 0.9% of its size."])
    assert of_shape(shaped(swollen=True))["value"] == DOUBTFUL


@each_case(
    "changes, reasons, value",
    [
        ({}, [], GOOD),
        ({"asymmetry": 0.5, "flatness": 0.5, "contacts": 0.5}, [], GOOD),
        ({"cut_share": 0.01}, [], GOOD),
        ({"cut_share": 0.011}, [], DOUBTFUL),
        ({"flipped_faces": 1}, [], DOUBTFUL),
        ({}, ["It hardly shows."], DOUBTFUL),
    ],
)
def test_a_change_in_plain_words_is_good_unless_something_speaks_against_it(
    changes: dict[str, Any], reasons: list[str], value: str
) -> None:
    said = verdict_of_change({**STRUCTURE, **changes}, reasons)
    assert (said["value"], said["reasons"][: len(reasons)]) == (value, reasons)
    assert said["structure"] == {**STRUCTURE, **changes}


@each_case("share, value", [(0.15, GOOD), (0.16, DOUBTFUL)])
def test_parts_that_grow_may_enter_those_beside_them(share: float, value: str) -> None:
    assert verdict_of_change({**STRUCTURE, "cut_share": share}, of_parts=True)["value"] == value


def test_of_several_guidances_the_worst_counts() -> None:
    good, doubtful = of_shape(WHOLE), of_target(fit(0.5, 0.5), WHOLE)
    bad = of_target(fit(1.0, 0.1), shaped(swollen=True))
    assert worst([good]) == good
    both = worst([good, doubtful, doubtful])
    assert both["value"] == DOUBTFUL
    assert both["reasons"] == good["reasons"] + doubtful["reasons"]
    assert worst([doubtful, bad, good])["value"] == KEEP_SOURCE


def test_every_figure_that_has_a_limit_counts() -> None:
    for name, limit in LIMITS.items():
        assert of_shape(shaped(**{name: 100 * limit + 1}))["value"] == DOUBTFUL


@each_case(
    "stored, expected",
    [
        (None, None),
        ("keep_result", None),
        ({"value": "good", "reasons": ["It is."], "structure": {}}, ("good", ["It is."])),
        ({"value": "keep_source", "reasons": ["It broke."]}, ("keep_source", ["It broke."])),
        ({"value": "keep_result", "reasons": []}, ("doubtful", ["An earlier version made this result."])),
        ({"value": "of a later version", "reasons": ["It glows."]}, ("doubtful", ["It glows."])),
    ],
)
def test_a_stored_verdict_is_read_whichever_version_wrote_it(
    stored: object, expected: tuple[str, list[str]] | None
) -> None:
    found = read_verdict({"verdict": stored})
    if expected is None:
        assert found is None
        return
    assert found is not None
    value, reasons = expected
    assert found["value"] == value
    assert found["value"] in list(Verdict)
    assert found["reasons"][0].startswith(reasons[0])
    assert found["advice"] == []


def test_what_the_judge_does_not_know_is_told_by_the_distance_that_is_left() -> None:
    near, far = of_shape_alone(0.03, WHOLE), of_shape_alone(0.8, WHOLE)
    assert (near["value"], near["reasons"]) == (GOOD, ["3% of the distance to that shape is left."])
    assert (far["value"], far["advice"][0][:3]) == (DOUBTFUL, "Ask")
