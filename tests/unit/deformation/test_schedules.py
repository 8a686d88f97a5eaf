"""What changes over a run: rates, regularisers, the views' resolution, and the smoothing of gradients."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.schedules import annealed
from meshdeform.deformation.smoothing import STAGES, GradientSmoothing
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import box, grid, icosphere, join
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.target import TargetGuidance
from meshdeform.rendering.cameras import CameraRange, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.rendering.views import Views
from meshdeform.requests.choices import Annealing, ViewMode
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve

F64 = torch.float64
STYLE = RenderStyle(view_size=16, supersample=1)


def params(**changes: object) -> ResolvedParams:
    return resolve(DeformParams.model_validate({"preset": "preview", "guidance": "target", **changes}))


def target(size: int = 16) -> TargetGuidance:
    ball = icosphere(1, 0.6)
    shape = ball.verts * torch.tensor([0.6, 1.4, 0.9], dtype=F64)
    return TargetGuidance(TriangleMesh(shape, ball.faces), style=RenderStyle(view_size=size, supersample=1))


def test_both_curves_meet_at_the_ends_and_in_the_middle() -> None:
    for kind in Annealing:
        assert [annealed(8.0, 2.0, f, kind) for f in (0.0, 0.5, 1.0)] == pytest.approx([8.0, 5.0, 2.0])
    assert annealed(8.0, 2.0, 0.25) == pytest.approx(6.5)
    assert annealed(8.0, 2.0, 0.25, Annealing.COSINE) == pytest.approx(2 + 6 * (1 + math.cos(math.pi / 4)) / 2)


def test_the_rate_of_every_tensor_goes_to_its_end() -> None:
    settings = params(steps=5, learning_rate=0.01, learning_rate_end=0.002, translation_rate=3.0)
    run = Deformation(icosphere(1, 0.6), target(), settings)
    found = [[group["lr"] for group in run._optimizer.param_groups] for _ in run]
    wanted = [0.01, 0.008, 0.006, 0.004, 0.002]
    assert [rates[0] for rates in found] == pytest.approx(wanted)
    assert [rates[1] for rates in found] == pytest.approx([3 * rate for rate in wanted])


def test_the_end_of_the_rate_is_the_rate_that_was_written() -> None:
    assert params(learning_rate=0.04).learning_rate_end == 0.04
    assert params().learning_rate_end == params().learning_rate
    assert params(learning_rate_end=0.001).learning_rate == params().learning_rate


def test_regularisers_are_weighed_by_where_the_run_is() -> None:
    mesh = icosphere(1, 0.6)
    whole = Deformation(mesh, target(), params(steps=6, regularizer_scale_end=0.0))
    terms = [step.losses for step in whole]
    assert terms[-2]["jacobian"] > 0
    assert terms[-1]["jacobian"] == terms[-1]["laplacian"] == terms[-1]["normal"] == 0
    assert terms[-1]["guidance"] > 0


@pytest.mark.parametrize(
    "changes",
    [{"resolution_start": 0.25}, {"smoothing_start": 0.3}, {"learning_rate_end": 0.001, "annealing": "cosine"},
     {"dirichlet_weight": 0.1}, {"smoothing_start": 0.3, "optimizer": "adam_uniform"}],
)  # fmt: skip
def test_a_resumed_run_is_the_uninterrupted_one(changes: dict[str, object]) -> None:
    settings = params(steps=12, coarse_until=0.8, **changes)
    mesh = icosphere(1, 0.6)
    plain = Deformation(mesh, target(), params(steps=12))
    whole, first = (Deformation(mesh, target(), settings) for _ in range(2))
    for run in (plain, whole):
        for _ in run:
            pass
    for step in first:
        if step.step == 5:
            break
    second = Deformation(mesh, target(), settings, checkpoint=first.checkpoint())
    for _ in second:
        pass
    assert torch.equal(second.verts(), whole.verts())
    assert not torch.equal(plain.verts(), whole.verts()), "the option does something"


class _Sizes:
    """Notes how sharp the pictures are that it is shown."""

    style = single_style = RenderStyle(view_size=16, supersample=1)

    def __init__(self) -> None:
        self.identity = {"id": "sizes", "revision": "", "sha256": ""}
        self.shapes: list[tuple[int, ...]] = []

    def loss(self, image: Tensor, context: StepContext) -> tuple[Tensor, dict[str, float]]:
        self.shapes.append(tuple(image.shape))
        return image.sum() * 1e-3, {}

    def grade(self, image: Tensor, context: StepContext) -> float:
        return float(image.sum())


def test_views_are_drawn_small_at_first_and_shown_at_their_size(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []
    render = Renderer.render

    def noted(self: Renderer, *arguments: object) -> Tensor:
        drawn.append(self.style.view_size)
        return render(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Renderer, "render", noted)
    guidance = _Sizes()
    settings = params(steps=9, resolution_start=0.25, coarse_until=0.5)
    for _ in Deformation(icosphere(1, 0.6), guidance, settings):
        pass
    # Linear from a quarter to the whole over the first half of the run, rounded up to eighths of 16.
    assert drawn == [4, 8, 10, 14, 16, 16, 16, 16, 16]
    assert set(guidance.shapes) == {(1, 3, 32, 32)}


def test_an_enlarged_view_shows_what_the_view_shows() -> None:
    mesh = box(2, (0.8, 0.5, 0.6))
    guidance = target(64)
    views = Views(ViewMode.ORTHOGONAL_GRID, CameraRange(), guidance, resolution_start=0.5)
    renderer, cameras = Renderer(mesh.faces, len(mesh.verts), guidance.style), fixed_cameras(30.0, 20.0)
    large = views.arrange(renderer.render(mesh.verts, cameras))
    small = views.arrange(renderer.at(views.size(0.0)).render(mesh.verts, cameras))
    assert small.shape == large.shape
    assert 0 < float((small - large).abs().mean()) < 0.02


@pytest.mark.parametrize("mesh", [icosphere(2), join(icosphere(1), TriangleMesh(grid(4).verts + 5, grid(4).faces))])
def test_smoothing_is_symmetric_and_goes_downhill(mesh: TriangleMesh) -> None:
    generator = torch.Generator().manual_seed(0)
    smoothing = GradientSmoothing(mesh, 0.2, 1.0)
    a, b = (torch.randn(len(mesh.faces), 3, 3, generator=generator, dtype=F64) for _ in range(2))
    smooth_a, smooth_b = smoothing.apply(a, 0.0), smoothing.apply(b, 0.0)
    assert float(smooth_a.norm()) == pytest.approx(float(a.norm()))
    assert float((smooth_a * a).sum()) > 0
    # The length is kept, so what is symmetric are the products over the factors that keep it.
    kept = [float((p * q).sum()) for p, q in ((smooth_a, b), (a, smooth_b))]
    factors = [float(x.norm() / _plain(smoothing, x).norm()) for x in (a, b)]
    assert kept[0] / factors[0] == pytest.approx(kept[1] / factors[1], rel=1e-6)


def _plain(smoothing: GradientSmoothing, gradient: Tensor) -> Tensor:
    solved = [smoothing._factor(0).solve(smoothing._to_verts @ gradient[:, k].numpy()) for k in range(3)]
    return torch.stack([torch.from_numpy(smoothing._to_verts.T @ part) for part in solved], 1)


def test_smoothing_spreads_a_single_face_as_far_as_its_length_and_not_to_another_component() -> None:
    ball = icosphere(3)
    mesh = join(ball, TriangleMesh(ball.verts + torch.tensor([2.01, 0.0, 0.0], dtype=F64), ball.faces))
    centre = mesh.verts[mesh.faces].mean(1)
    at = int(centre[: len(ball.faces), 0].argmax())
    gradient = torch.zeros(len(mesh.faces), 3, 3, dtype=F64)
    gradient[at] = 1.0
    smoothing = GradientSmoothing(mesh, 0.1, 0.5)
    reach = []
    for stage in range(STAGES):
        spread = smoothing.apply(gradient, 0.5 * stage / STAGES).norm(dim=(1, 2))
        assert float(spread[len(ball.faces) :].max()) == 0
        reach.append(float((spread * (centre - centre[at]).norm(dim=1)).sum() / spread.sum()))
    assert reach[0] > reach[1] > reach[2] > reach[3] > 0
    assert torch.equal(smoothing.apply(gradient, 0.5), gradient)


def test_smoothing_is_of_jacobians() -> None:
    with pytest.raises(ParameterError, match="moves vertices"):
        params(smoothing_start=0.1, parametrization="vertices")
