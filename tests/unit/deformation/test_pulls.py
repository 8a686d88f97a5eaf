"""The pulls of regularisers are norms of gradients against the guidance's, and on needles stay below it."""

from __future__ import annotations

import math

import pytest
import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.regularizers import Pulls
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.goals import score_distillation
from tests.cases import each_case
from training.evaluation.summary import outweighed


def test_a_pull_is_the_norm_of_the_gradient_summed_over_the_measured_steps() -> None:
    first, second = (torch.zeros(n, dtype=torch.float64, requires_grad=True) for n in (4, 3))
    unused = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    pulls = Pulls()
    assert pulls.to_dict() is None
    for step in range(60):
        slope = 3.0 if step == 10 else 9.0  # measured at 10, 30 and 50
        terms = {"guidance": slope * first.sum(), "normal": first.sum() + 2 * second[0]}
        pulls.measure(terms, [first, second, unused], step)
    ratios = pulls.to_dict()
    assert ratios is not None
    assert ratios["normal"] == pytest.approx(3 * math.sqrt(8) / (6 + 18 + 18))
    assert ratios["laplacian"] == 0
    assert first.grad is None


def cylinder(radius: float, sides: int = 96) -> TriangleMesh:
    """A closed cylinder of needles, whose sides are some thirty times as long as wide."""
    angle = torch.arange(sides, dtype=torch.float64) * (2 * math.pi / sides)
    ring = torch.stack([radius * angle.cos(), torch.full_like(angle, 0.5), radius * angle.sin()], 1)
    axis = torch.tensor([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]], dtype=torch.float64)
    verts = torch.cat([ring, ring * torch.tensor([1.0, -1.0, 1.0]), axis])
    here = torch.arange(sides)
    there = (here + 1) % sides
    top, bottom = torch.full_like(here, 2 * sides), torch.full_like(here, 2 * sides + 1)
    corners = [(here, there, here + sides), (there, there + sides, here + sides), (here, top, there)]
    corners.append((here + sides, there + sides, bottom))
    faces = torch.cat([torch.stack(each, 1) for each in corners])
    return TriangleMesh(verts, faces.flip(1))


def needles() -> TriangleMesh:
    """Two cylinders beside each other: a multi-part asset."""
    part = cylinder(0.25)
    shift = torch.tensor([0.3, 0.0, 0.0], dtype=torch.float64)
    return join(TriangleMesh(part.verts - shift, part.faces), TriangleMesh(part.verts + shift, part.faces))


@each_case("mesh", [cylinder(0.25), needles()])
def test_on_needles_no_regulariser_outweighs_the_guidance(mesh: TriangleMesh) -> None:
    settings = resolve(DeformParams.model_validate({"preset": "preview", "steps": 60}))
    deformation = Deformation(mesh, score_distillation(BuiltinPrior(), "a bus", settings), settings)
    for _ in deformation:
        pass
    pulls = deformation.pulls.to_dict()
    assert pulls is not None
    assert {name for name, pull in pulls.items() if pull > 0} >= {"normal", "dirichlet"}
    assert max(pulls.values()) < 1, pulls
    assert not deformation.pulls.warnings


def test_a_regulariser_that_decides_is_named() -> None:
    settings = resolve(DeformParams.model_validate({"preset": "preview", "steps": 31, "jacobian_reg_weight": 3000}))
    deformation = Deformation(cylinder(0.25), score_distillation(BuiltinPrior(), "a bus", settings), settings)
    for _ in deformation:
        pass
    (warning,) = deformation.pulls.warnings
    assert "jacobian" in warning
    record = {"source": "cylinder", "prompt": "a bus", "seed": 0, "pulls": deformation.pulls.to_dict()}
    (line,) = outweighed([record, {**record, "pulls": None}])
    assert line.startswith("cylinder, a bus, seed 0: `jacobian`")
