"""A target mesh: zero where the views agree, downhill where they do not."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from meshdeform.deformation.loop import Deformation
from meshdeform.errors import AlignmentError, NumericalError, ShapeError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure
from meshdeform.geometry.shapes import icosphere, join
from meshdeform.geometry.target_distance import measure_fit
from meshdeform.geometry.tensors import face_cross, faces_of, verts_of
from meshdeform.guidance.alignment import aligned, require_overlap, shared_coordinates
from meshdeform.guidance.base import StepContext
from meshdeform.guidance.landmarks import Landmark, diagonal_of
from meshdeform.guidance.points import PointTerm
from meshdeform.guidance.target import TargetGuide
from meshdeform.rendering.cameras import CameraFrame, fixed_cameras
from meshdeform.rendering.shading import Renderer, RenderStyle
from meshdeform.rendering.views import combine_views
from meshdeform.requests.choices import Carrier
from tests.cases import each_case
from tests.close import assert_close
from tests.meshes import mesh_of
from tests.unit.deformation.worlds import params
from training.shapes import box, grid, lathe

STYLE = RenderStyle(view_size=32, supersample=1, shading="normals")
CONTEXT = StepContext(0, 10, fixed_cameras(20.0, 15.0), torch.Generator().manual_seed(0))
SPHERE = icosphere(3)


def picture(scale: torch.Tensor) -> torch.Tensor:
    renderer = Renderer(faces_of(SPHERE), verts_of(SPHERE).shape[0], STYLE)
    return combine_views(renderer.render(verts_of(SPHERE) * scale, CONTEXT.cameras))


def scaled(*factors: float) -> TriangleMesh:
    return mesh_of(verts_of(SPHERE) * torch.tensor(factors, dtype=torch.float64), faces_of(SPHERE))


def test_a_difference_of_a_tenth_costs_one() -> None:
    guidance = TargetGuide(scaled(0.7, 0.7, 0.7), style=STYLE)
    same = picture(torch.full((3,), 0.7, dtype=torch.float64))
    for shift, cost in ((0.0, 0.0), (0.1, 1.0)):
        loss, logs = guidance.loss(same + shift, CONTEXT)
        assert loss.item() == pytest.approx(cost, rel=1e-4)
        assert logs["target_mse"] == pytest.approx(0.01 * cost, rel=1e-4)
    with pytest.raises(ShapeError, match="expected an image"):
        guidance.loss(torch.zeros(1, 3, 16, 16), CONTEXT)
    with pytest.raises(NumericalError):
        guidance.loss(torch.full((1, 3, 64, 64), torch.nan), CONTEXT)


def test_the_identity_is_the_meshs_own() -> None:
    one, same, other = (TargetGuide(scaled(x, 1.0, 1.0), style=STYLE).identity for x in (0.5, 0.5, 0.6))
    assert one == same != other
    assert TargetGuide(SPHERE, style=STYLE, identity={"id": "cow.glb"}).identity == {"id": "cow.glb"}


# Fits to a mesh: alignment, distances in both directions, gates, landmarks, and what a whole run reaches.


NOWHERE = torch.zeros(3, dtype=torch.float64)


def framed(mesh: TriangleMesh) -> TriangleMesh:
    return CameraFrame.around(mesh.verts).place(mesh)


def moved(mesh: TriangleMesh, scale: float, turn_deg: float, shift: tuple[float, float, float]) -> TriangleMesh:
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    about_y = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    return mesh_of(scale * verts_of(mesh) @ about_y.T + torch.tensor(shift, dtype=torch.float64), faces_of(mesh))


def wedge() -> TriangleMesh:
    """A body without symmetry: a large box, and a small one in front of it to one side."""
    small = box(2, (0.4, 0.3, 0.9))
    return join(box(3), mesh_of(verts_of(small) + torch.tensor([0.3, 0.4, 0.8], dtype=torch.float64), faces_of(small)))


def cone() -> TriangleMesh:
    profile = [(0.0, 0.0), (0.25, 0.0), *((0.5 * (1 - k / 12), k / 12) for k in range(13))]
    return lathe(profile, 24)


def fit(rest: TriangleMesh, target: TriangleMesh, landmarks: tuple[Landmark, ...] = (), **given: object) -> Deformation:
    resolved = params(**given)
    guidance = TargetGuide(target, point_weight=resolved.point_weight, landmarks=landmarks)
    run = Deformation(rest, guidance, resolved)
    for _ in run:
        pass
    return run


@each_case("turn", [0.0, 37.3, 180.0, -101.0])
def test_a_turned_and_scaled_copy_is_aligned_to_a_thousandth_of_the_diagonal(turn: float) -> None:
    rest = framed(wedge())
    target = moved(wedge(), 3.7, turn, (5.0, -2.0, 1.0))
    found = aligned(target, rest)
    apart = (verts_of(found.place_mesh(target)) - verts_of(rest)).norm(dim=1).max()
    assert float(apart) < 1e-3 * diagonal_of(rest)
    assert found.overlap == 1.0


def test_landmarks_choose_the_turn_of_a_symmetric_body() -> None:
    front, left = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    assert aligned(SPHERE, SPHERE, [Landmark(front, left)]).turn_deg == pytest.approx(-90.0, abs=0.5)


def test_a_target_far_away_is_refused_with_its_overlap() -> None:
    away = moved(SPHERE, 1000.0, 0.0, (0.0, 0.0, 0.0))
    with pytest.raises(AlignmentError, match="Only 0%") as refused:
        require_overlap(shared_coordinates(away, SPHERE), "Set params.align to auto.")
    assert refused.value.extra["alignment"]["overlap"] == 0.0
    require_overlap(aligned(away, SPHERE), "")


def test_equal_surfaces_do_not_pull() -> None:
    term = PointTerm(SPHERE, samples=500)
    term.begin(SPHERE)
    assert float(term.pair(verts_of(SPHERE), NOWHERE, 0.0).norm()) < 1e-12
    verts = verts_of(SPHERE).clone().requires_grad_()
    loss, share = term.loss(verts, NOWHERE)
    loss.backward()
    assert (loss.item(), share) == (pytest.approx(0.0, abs=1e-12), 1.0)
    assert float(verts.grad.abs().max()) < 1e-9


def test_the_loss_of_a_translation_has_its_value_in_closed_form() -> None:
    """Two parallel squares a hundredth of the diagonal apart: e = 1 for all samples, in both directions."""
    sheet = grid(4)
    up = face_cross(verts_of(sheet), faces_of(sheet))[0]
    step = 0.01 * diagonal_of(sheet) * up / up.norm()
    term = PointTerm(sheet, samples=400)
    term.begin(sheet)
    pull = term.pair(verts_of(sheet) + step, NOWHERE, 0.0)
    assert_close(pull, -step, atol=1e-9, rtol=0)
    loss, share = term.loss(verts_of(sheet) + step, NOWHERE)
    assert share == 1.0
    assert loss.item() == pytest.approx(4 * (math.sqrt(2) - 1))


@each_case("reason", ["distance", "normals", "border"])
def test_gated_pairs_do_not_pull(reason: str) -> None:
    sheet = grid(4)
    up = face_cross(verts_of(sheet), faces_of(sheet))[0]
    span = (verts_of(sheet)[faces_of(sheet)[0, 1]] - verts_of(sheet)[faces_of(sheet)[0, 0]]) / 0.25
    target, verts, fraction = sheet, verts_of(sheet), 0.0
    if reason == "distance":
        verts, fraction = verts_of(sheet) + 0.05 * diagonal_of(sheet) * up / up.norm(), 1.0
    elif reason == "normals":
        target = mesh_of(verts_of(sheet), faces_of(sheet).flip(1))
    else:
        verts = verts_of(sheet) + 5 * span
    term = PointTerm(target, samples=400)
    term.begin(sheet)
    term.pair(verts, NOWHERE, fraction)
    verts = verts.clone().requires_grad_()
    loss, share = term.loss(verts, NOWHERE)
    loss.backward()
    assert share == loss.item() == float(verts.grad.abs().max()) == 0.0


@each_case("carrier", [Carrier.SURFACE, Carrier.LATTICE])
def test_a_sphere_becomes_an_ellipsoid(carrier: Carrier) -> None:
    rest = framed(SPHERE)
    target = mesh_of(verts_of(rest) * torch.tensor([0.7, 1.3, 1.0], dtype=torch.float64), faces_of(rest))
    run = fit(rest, target, carrier=carrier, steps=50)
    found = measure_fit(mesh_of(run.verts(), faces_of(rest)), target)
    assert found.within > 0.99
    assert max(found.to_target, found.from_target) < 0.003


def test_a_cone_is_reached_without_distortion() -> None:
    """A target that is placed by its box lies 0.2 below where the solve keeps the sphere: distortion was 5.4 then."""
    rest = framed(SPHERE)
    target = aligned(cone(), rest).place_mesh(cone())
    verts = fit(rest, target).verts()
    quality = measure(rest.verts, rest.faces, verts.numpy())
    assert measure_fit(mesh_of(verts, faces_of(rest)), target).within > 0.95
    assert quality.symmetric_dirichlet_mean < 1.3
    assert quality.flipped_faces == 0


def test_the_result_goes_where_the_target_is() -> None:
    """The solve keeps the centre of mass, so the translation is found beside it."""
    rest = framed(SPHERE)
    shift = torch.tensor([0.03, 0.0, -0.02], dtype=torch.float64)
    run = fit(rest, mesh_of(verts_of(rest) + shift, faces_of(rest)), steps=20)
    assert_close(run.verts().mean(0), verts_of(rest).mean(0) + shift, atol=6e-3, rtol=0)


def test_a_landmark_is_honoured() -> None:
    rest = framed(SPHERE)
    top = verts_of(rest)[verts_of(rest)[:, 1].argmax()].numpy()
    goal = np.array([0.25, math.sqrt(0.6**2 - 0.25**2), 0.0])
    index = int(verts_of(rest)[:, 1].argmax())
    free, led = (fit(rest, rest, marks, steps=40) for marks in ((), (Landmark(top, goal),)))
    apart = [float(np.linalg.norm(run.verts()[index].numpy() - goal)) / diagonal_of(rest) for run in (free, led)]
    assert apart[0] > 0.1
    assert apart[1] < 0.02


def test_a_resumed_fit_equals_an_uninterrupted_one_bit_for_bit() -> None:
    """Step 13 lies between two searches for pairs, which are found again."""
    rest = framed(SPHERE)
    target = aligned(cone(), rest).place_mesh(cone())
    resolved = params(steps=16)

    def begin() -> Deformation:
        return Deformation(rest, TargetGuide(target, point_weight=resolved.point_weight), resolved)

    whole, half = begin(), begin()
    for step in whole:
        assert step.losses["paired_share"] > 0
    for step in half:
        if step.step == 13:
            break
    rerun = begin()
    rerun.restore(half.checkpoint())
    for _ in rerun:
        pass
    assert torch.equal(rerun.verts(), whole.verts())
