"""Our presets for Stable Diffusion on the real classes, random weights: few controls, the paper's penalties, resume."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from meshdeform.assets import build_glb
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.requests.document import DeformParams, JobRequest, resolve
from meshdeform.requests.removed import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input
from tests.cases import each_case

BALL = icosphere(1)
PAIR = join(BALL, TriangleMesh(0.4 * BALL.verts + torch.tensor([0.0, 1.3, 0.3], dtype=torch.float64), BALL.faces))


@pytest.fixture(scope="module")
def prior(tiny_stable_diffusion: Path) -> StableDiffusionPrior:
    return StableDiffusionPrior(str(tiny_stable_diffusion))


def begin(prior: StableDiffusionPrior, mesh: TriangleMesh, **given: Any) -> text_deform.TextDeformRun:
    params = {"preset": "preview", "steps": 4, "guidance": {"model": "tiny-sd", "appearance": "clay"}}
    request = JobRequest.model_validate({"prompt": "a pear", "params": grouped(params)})
    asset = build_glb(mesh.verts.numpy(), mesh.faces.numpy())
    return text_deform.start(job_input(asset=asset, filename="a.glb", request=request, prior=prior, **given))


@each_case("mesh, kind, elements", [(BALL, "surface", "face"), (PAIR, "lattice", "cell")])
def test_a_preset_moves_few_controls_and_resumes_to_the_bit(
    prior: StableDiffusionPrior, mesh: TriangleMesh, kind: str, elements: str
) -> None:
    whole = begin(prior, mesh)
    steps = iter(whole)
    next(steps)
    saved = whole.checkpoint()
    state = whole._deformation.checkpoint().tensors
    assert state[f"{elements}_level_0"].abs().max() > 0
    assert (state[f"{elements}_level_2"] == 0).all(), "it is unlocked later"
    list(steps)
    resumed = begin(prior, mesh, checkpoint=saved)
    list(resumed)
    assert (whole.positions() == resumed.positions()).all()
    report = json.loads(whole.finish()["report.json"].data)
    assert (report["carrier"]["kind"], report["carrier"]["mirror"]) == (kind, "x")


@each_case("preset", ["preview", "balanced"])
def test_the_weights_are_the_papers(preset: str) -> None:
    ours, paper = (
        resolve(DeformParams.model_validate({"preset": name, "guidance": {"model": "tiny-sd"}}))
        for name in (preset, "paper")
    )
    for name in ("guidance_weight", "jacobian_reg_weight", "laplacian_weight", "normal_weight", "dirichlet_weight"):
        assert getattr(ours, name) == getattr(paper, name), name
