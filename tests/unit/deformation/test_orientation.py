"""The front of a source: found where there is one, kept where there is none, part of the checkpoint."""

from __future__ import annotations

import math
from functools import cache

import pytest
import torch
from torch import Tensor

from meshdeform.deformation.checkpoint import dump_checkpoint, load_checkpoint
from meshdeform.deformation.loop import Deformation
from meshdeform.deformation.orientation import Mixture, Orientation, OrientationSource, find_orientation
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors.builtin.prior import BuiltinPrior
from meshdeform.rendering.cameras import Cameras, Frame, fixed_cameras
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.goals import score_distillation
from tests.cases import each_case
from tests.unit.deformation import worlds
from training.evaluation.sources import source_mesh


@cache
def prior() -> BuiltinPrior:
    return BuiltinPrior()


def params(**changes: object) -> ResolvedParams:
    return worlds.params(**{"guidance": "sds", "steps": 2, "safeguard": "none", **changes})


def turned(mesh: TriangleMesh, degrees: float) -> TriangleMesh:
    """The mesh turned about the up axis: its front is then at this azimuth."""
    s, c = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    matrix = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    return TriangleMesh(mesh.verts @ matrix.T, mesh.faces)


def placed(name: str, degrees: float = 0.0) -> TriangleMesh:
    mesh = turned(source_mesh(name), degrees)
    return Frame.around(mesh.verts).place(mesh)


def deformation(mesh: TriangleMesh, prompt: str = "a giraffe", **changes: object) -> Deformation:
    settings = params(**changes)
    return Deformation(mesh, score_distillation(prior(), prompt, settings), settings)


def test_the_front_of_a_turned_animal_is_found() -> None:
    degrees = 90.0  # 180 is that of the resumed run below
    found = deformation(placed("quadruped", degrees)).orientation
    assert found.source is OrientationSource.FOUND
    assert abs((found.turn_deg - degrees + 180) % 360 - 180) <= 15
    assert found.margin > 0.05


@each_case(
    ("source", "prompt", "told"),
    [
        ("quadruped", "a giraffe", OrientationSource.FOUND),  # its mirror plane leaves two sides
        ("vase", "a rabbit", OrientationSource.UNDECIDED),
        ("cube", "a chair", OrientationSource.UNDECIDED),
    ],
)
def test_what_faces_forward_or_is_symmetric_is_kept(source: str, prompt: str, told: OrientationSource) -> None:
    found = deformation(placed(source), prompt).orientation
    assert (found.turn_deg, found.source) == (0.0, told)


def test_a_turned_source_with_its_angle_gives_the_same_result_turned() -> None:
    plain = deformation(placed("quadruped"), orientation="keep", steps=4)
    other = deformation(placed("quadruped", 90.0), orientation=90.0, steps=4)
    losses = [[step.losses["sds_mse"] for step in run] for run in (plain, other)]
    assert losses[0] == pytest.approx(losses[1], rel=3e-3)
    moved = float((plain.verts() - plain.mesh.verts).norm())
    expected = turned(TriangleMesh(plain.verts(), plain.mesh.faces), 90.0).verts
    assert float((other.verts() - expected).norm()) < 0.05 * moved


def test_a_resumed_run_has_the_turn_of_its_checkpoint_and_does_not_search(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = placed("quadruped", 180.0)
    whole = deformation(mesh, steps=4)
    assert abs(abs(whole.orientation.turn_deg) - 180) <= 15
    next(iter(whole))
    stored = dump_checkpoint(whole.checkpoint(), "run")
    list(whole)
    monkeypatch.setattr(ScoreDistillation, "grades", None)
    settings = params(steps=4)
    guidance = score_distillation(prior(), "a giraffe", settings)
    second = Deformation(mesh, guidance, settings, checkpoint=load_checkpoint(stored, "run"))
    assert second.orientation == whole.orientation
    assert second.orientation.source is OrientationSource.FOUND
    list(second)
    for name, value in whole.checkpoint().tensors.items():
        assert torch.equal(second.checkpoint().tensors[name], value), name


def test_a_continued_run_takes_the_turn_of_its_origin(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = placed("quadruped")
    origin = deformation(mesh, orientation=75.0).checkpoint().tensors
    monkeypatch.setattr(ScoreDistillation, "grades", None)
    for initial, changes, expected in (
        (origin, {}, (75.0, OrientationSource.CONTINUED)),
        (origin, {"orientation": "keep"}, (0.0, OrientationSource.KEPT)),
        (origin, {"orientation": -30}, (-30.0, OrientationSource.GIVEN)),
    ):
        settings = params(**changes)
        guidance = score_distillation(prior(), "a fish", settings)
        found = Deformation(mesh, guidance, settings, initial=initial).orientation
        assert (found.turn_deg, found.source) == expected


class _Grades:
    """Grades with a known best azimuth, or equal ones."""

    def __init__(self, best_deg: float | None, gain: float = 0.3, noise: float = 0.01) -> None:
        self.best, self.gain, self.noise = best_deg, gain, noise
        self.calls = 0

    def grades(self, image: Tensor, poses: list[Cameras], fraction: float, generator: torch.Generator) -> Tensor:
        self.calls += len(poses)
        if self.best is None:
            return torch.ones(len(poses), dtype=torch.float64)
        noise = self.noise * torch.randn(len(poses), generator=generator, dtype=torch.float64)
        off = [math.radians(float(image) - self.best - pose.azimuth_deg) for pose in poses]
        return 1 - self.gain * torch.tensor([math.cos(angle) for angle in off], dtype=torch.float64) + noise


def _draw(azimuth_deg: float, generator: torch.Generator) -> tuple[Tensor, Cameras]:
    return torch.tensor(azimuth_deg), fixed_cameras(azimuth_deg, 0.0)


@each_case("best", [45.0, -100.0, 180.0, 70.0])
def test_the_best_angle_is_found_within_the_finer_step(best: float) -> None:
    guidance = _Grades(best)
    found = find_orientation(_draw, guidance, 3)
    assert abs((found.turn_deg - best + 180) % 360 - 180) <= 15
    assert found == find_orientation(_draw, _Grades(best), 3)
    assert Orientation.from_tensor(found.to_tensor()) == found
    assert guidance.calls <= 48


@each_case(("gain", "noise", "found"), [(0.014, 0.0, False), (0.016, 0.0, True), (0.016, 0.05, False)])
def test_a_side_is_the_front_from_three_per_cent_and_three_errors_on(gain: float, noise: float, found: bool) -> None:
    """The grade of the back is `1 + gain`, that of the front `1 - gain`."""
    source = find_orientation(_draw, _Grades(180.0, gain, noise), 3).source
    assert (source is OrientationSource.FOUND) is found


def test_a_model_without_azimuth_is_asked_twice_and_the_back_must_be_much_better_than_the_front() -> None:
    guidance = _Grades(None)
    found = find_orientation(_draw, guidance, 0)
    assert (found.turn_deg, found.source, guidance.calls) == (0.0, OrientationSource.UNCONDITIONED, 2)
    for contrast, turn in ((0.03, 0.0), (0.1, 180.0)):
        found = find_orientation(_draw, _Grades(180.0, contrast), 0, planes=(0,))
        assert found.turn_deg == turn
        assert found.margin == pytest.approx(2 * contrast, abs=0.02)


def test_several_nouns_are_asked_with_one_noise_and_count_by_their_weights() -> None:
    poses = [fixed_cameras(azimuth, 0.0) for azimuth in (0.0, 90.0)]
    image, generator = torch.tensor(0.0), torch.Generator().manual_seed(4)
    mixed = Mixture([(_Grades(0.0), 0.75), (_Grades(180.0), 0.25)]).grades(image, poses, 0.94, generator)
    alone = _Grades(0.0, 0.15).grades(image, poses, 0.94, torch.Generator().manual_seed(4))
    assert mixed == pytest.approx(alone)
