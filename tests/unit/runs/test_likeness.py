"""The report says whether a result looks like its prompt."""

from __future__ import annotations

import json

import torch

from meshdeform.assets import build_glb
from meshdeform.cli.report_lines import likeness_line
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.priors import load_prior
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from meshdeform.runs.verdict import before, likeness, likeness_and_before, recognise, summarize
from tests.cases import each_case
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
