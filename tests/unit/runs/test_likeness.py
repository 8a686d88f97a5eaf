"""The report says whether a result looks like its prompt."""

from __future__ import annotations

import json

import torch

from meshdeform.assets import build_glb
from meshdeform.cli.likeness import likeness_line
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.judge.training.members import HELD_OUT, seeded
from meshdeform.priors import load_prior
from meshdeform.priors.builtin.training.families import member
from meshdeform.requests.document import JobRequest
from meshdeform.runs import text_deform
from meshdeform.runs.text_report import likeness, summarize
from tests.cases import each_case


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
    assert likeness_line(summarize(odds, "rabbit")) == "Looks like: a rabbit (83%); next: a cat (6%)"
    assert likeness_line(summarize(odds, "elephant")) == (
        "Does not look like its prompt: it looks more like a rabbit (83%); an elephant (under 1%) is number 3 of 3"
    )


@each_case("guidance", ["sds", "target"])
def test_only_the_builtin_prior_has_it_in_its_report(guidance: str) -> None:
    ball = icosphere(1)
    asset = build_glb(ball.verts.numpy(), ball.faces.numpy())
    params = {"preset": "preview", "steps": 1, "guidance": guidance}
    request = JobRequest.model_validate({"prompt": "a mushroom", "params": params})
    run = text_deform.start(
        asset=asset, filename="a.glb", request=request, target=asset, prior=load_prior("builtin", device="cpu")
    )
    list(run)
    report = json.loads(run.finish()["report.json"].data)
    assert ("likeness" in report) == (guidance == "sds")
    if guidance == "sds":
        assert report["likeness"]["noun"] == "mushroom"
