"""The lines that `meshdeform run` prints."""

from __future__ import annotations

import pytest
import typer

from meshdeform.cli.report_lines import (
    exemplar_lines,
    orientation_line,
    prompt_lines,
    reading_lines,
    source_line,
)
from meshdeform.cli.request import read_prompt
from meshdeform.deformation.orientation import Orientation, OrientationSource
from meshdeform.requests.document import DeformParams


def test_a_front_that_was_found_is_named_and_one_that_was_given_is_not() -> None:
    found = Orientation(180.0, OrientationSource.FOUND)
    assert orientation_line(found.to_dict()) == "Front: the side at 180 degrees (0 is +Z, 90 is +X)"
    others = [source for source in OrientationSource if source is not OrientationSource.FOUND]
    lines = {source: orientation_line(Orientation(source=source).to_dict()) for source in others}
    assert lines[OrientationSource.UNDECIDED].endswith("no side is clearly better")
    assert "params.guidance.orientation" in lines[OrientationSource.UNCONDITIONED]
    assert "source_noun" in lines[OrientationSource.UNRECOGNISED]
    for source in (OrientationSource.KEPT, OrientationSource.GIVEN, OrientationSource.CONTINUED):
        assert not lines[source]


def test_what_an_asset_was_taken_for_and_what_was_kept_is_said() -> None:
    known = {"noun": "chair", "probability": 0.64, "recognised": True}
    carrier = {"kind": "lattice", "cells": 900, "mirror": "x", "level": True}
    said = source_line({"source_noun": known, "carrier": carrier})
    assert said.startswith("Taken for: chair (64%; --set source_noun=NOUN")
    assert said.endswith("Kept: mirror symmetry across x, level and upright")
    said = source_line({"source_noun": {**known, "recognised": False}, "carrier": {**carrier, "level": False}})
    assert said == "Kept: mirror symmetry across x"
    assert not source_line({"source_noun": None, "carrier": {"kind": "surface", "cells": None}})


def test_the_exemplar_is_named_with_what_was_paired() -> None:
    entry = {
        "target": None,
        "member": {"noun": "elephant", "number": 37, "form": "", "pose": "standing"},
        "distance_before": 0.05,
        "distance": 0.0123,
        "kept": 0.96,
        "pairs": [
            {"asset": part, "exemplar": other} for part, other in (("leg", "leg"), ("leg", "leg"), ("nose", "trunk"))
        ],
        "left_over": ["horn"],
        "missing": [],
    }
    assert list(exemplar_lines([entry])) == [
        "Fitted to: an elephant (member 37, standing); mean distance 1.23% of the diagonal, 5.00% before; it went "
        "96% of the way",
        "Paired: leg, nose as trunk; only the asset has: horn",
    ]
    moulded, _ = exemplar_lines([{**entry, "member": {"noun": "cat", "form": "cat", "way": "mould"}}])
    assert moulded.startswith("Moulded into: a cat; mean")
    sent = {**entry, "target": "target_2", "member": {"target": 1}, "pairs": [], "left_over": []}
    first, second = exemplar_lines([sent])
    assert first.startswith("Fitted to: target_2; mean")
    assert not second


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
    for text in ("", "@node=a", "a vase@", "a vase@head", "a vase@node=a@outside:node=b"):
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


def test_what_an_asset_was_read_as_is_told_with_what_else_it_may_be() -> None:
    nouns = [{"noun": noun, "probability": share} for noun, share in (("bear", 0.3), ("rhino", 0.2), ("cow", 0.1))]
    reading = {"noun": "rhino", "probability": 0.2, "sure": False, "nouns": nouns, "noun_given": False, "up": "+Y"}
    reading |= {"front_azimuth_deg": 0.0, "front_sure": True, "front_given": False}
    (line,) = reading_lines(reading)
    assert line.startswith("Read as: rhino (20%, or bear 30%, cow 10%; --source-noun NOUN corrects it)")
