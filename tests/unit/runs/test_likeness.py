"""The report says whether a result looks like its prompt."""

from __future__ import annotations

import json

import pytest
import torch

from meshdeform.assets import build_glb
from meshdeform.cli.report_lines import likeness_line
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from meshdeform.runs.verdict import (
    Recognition,
    before,
    front_of,
    known_source,
    likeness,
    likeness_and_before,
    recognise,
    summarize,
)
from tests.cases import each_case
from training.evaluation.sources import source_mesh
from training.judge.members import HELD_OUT, seeded
from training.prior.families import member


def test_a_shape_of_the_family_matches_its_prompt_and_no_other() -> None:
    part = member("giraffe", (), seeded(HELD_OUT, "giraffe", 2000))
    mesh = TriangleMesh(torch.from_numpy(part.verts), torch.from_numpy(part.faces))
    same, other = likeness(mesh, "a giraffe"), likeness(mesh, "a tall vase")
    assert same is not None
    assert other is not None
    assert (same["noun"], same["rank"], same["nouns"], same["matches"]) == ("giraffe", 1, 122, True)
    assert same["probability"] > same["next"]["probability"]
    assert other["noun"] == "vase"
    assert other["rank"] > 1
    assert other["next"] == {"noun": "giraffe", "probability": same["probability"]}
    assert other["matches"] is False
    assert set(same["judge"]) == {"id", "revision", "sha256"}


def test_the_line_names_both_nouns() -> None:
    odds = {"rabbit": 0.83, "cat": 0.06, "elephant": 0.001}
    assert (
        likeness_line(summarize(odds, "rabbit"))
        == "Looks like: a rabbit (83% among the judge's 3 nouns); next: a cat (6%)"
    )
    assert likeness_line(summarize(odds, "elephant")) == (
        "Does not look like its prompt: it looks more like a rabbit (83%); an elephant (under 1%) is number 3 of 3"
    )


def test_the_source_is_judged_once_and_compared_with() -> None:
    part = member("giraffe", (), seeded(HELD_OUT, "giraffe", 2000))
    result = TriangleMesh(torch.from_numpy(part.verts), torch.from_numpy(part.faces))
    known = likeness_and_before(icosphere(2), result, "a giraffe", {"giraffe": 0.2, "mushroom": 0.7, "vase": 0.1})
    asked = likeness_and_before(result, result, "a giraffe", {})
    assert known is not None
    assert asked is not None
    assert known["before"] == {"probability": 0.2, "rank": 2}
    assert asked["before"] == {"probability": asked["probability"], "rank": 1}
    assert {**known, "before": None} == {**asked, "before": None}


@each_case("guidance", ["sds", "target"])
def test_only_the_builtin_prior_has_it_and_a_verdict_in_its_report(guidance: str) -> None:
    ball = icosphere(1)
    asset = build_glb(ball.verts.numpy(), ball.faces.numpy())
    params = {"preset": "preview", "steps": 1, "guidance": {"kind": guidance}}
    request = JobRequest.model_validate({"prompt": "a mushroom", "params": params})
    run = text_deform.start(
        job_input(
            asset=asset, filename="a.glb", request=request, target=asset, prior=load_prior("builtin", device="cpu")
        )
    )
    list(run)
    report = json.loads(run.finish()["report.json"].data)
    assert ("likeness" in report) == ("verdict" in report) == (guidance == "sds")
    assert 0 <= report["quality"]["kept_share"] <= 1
    if guidance == "sds":
        assert report["likeness"]["noun"] == "mushroom"
        known = recognise(TriangleMesh(ball.verts.float().double(), ball.faces))
        assert report["likeness"]["before"] == before(summarize(known.nouns, "mushroom"))
        assert report["verdict"]["value"] == "keep_result"


# What a source is taken for, and what follows from it.


def test_a_noun_that_is_given_is_taken() -> None:
    known = recognise(icosphere(2), "chair")
    assert known.to_dict() == {"noun": "chair", "probability": 1.0, "recognised": True}


def test_a_source_is_recognised_by_the_judge() -> None:
    known = recognise(source_mesh("vase"))
    assert known.noun == "vase"
    assert known.sure
    assert known.built


@each_case(
    "noun, probability, built", [("chair", 0.6, True), ("chair", 0.4, False), ("dog", 0.9, False), ("tree", 0.9, False)]
)
def test_what_people_build_is_known_by_its_noun(noun: str, probability: float, built: bool) -> None:
    assert Recognition(noun, probability).built is built


def test_nobody_is_asked_for_the_front_of_what_is_not_recognised() -> None:
    prior, params = load_prior("builtin", device="cpu"), resolve(DeformParams())
    unsure = front_of(Recognition("dog", 0.3), prior, params, "a giraffe")
    assert unsure is not None
    assert unsure.grader is None
    assert unsure.grown
    sure = front_of(Recognition("dog", 0.7), prior, params, "")
    assert sure is not None
    assert sure.grader is not None
    assert not sure.grown
    vase = front_of(Recognition("bottle", 0.9), prior, params, "a tall vase")
    assert vase is not None
    assert (vase.built, vase.grown, vase.crooked) == (True, False, False)
    leaning = front_of(Recognition("bottle", 0.9), prior, params, "a leaning vase")
    assert leaning is not None
    assert leaning.crooked
    assert (
        known_source(icosphere(1), prior, resolve(DeformParams.model_validate({"guidance": {"orientation": "keep"}})))
        is None
    )
    assert known_source(icosphere(1), None, params) is None
    assert front_of(None, prior, params, "a giraffe") is None


def test_probabilities_are_rounded_in_the_report() -> None:
    assert Recognition("dog", 0.123456).to_dict()["probability"] == pytest.approx(0.1235)
