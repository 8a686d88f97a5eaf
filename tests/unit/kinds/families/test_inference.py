"""Templates, correspondences and parts of shapes whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from bench.parametric_families import PARTS, family
from meshdeform.assets import load_asset
from meshdeform.kinds.families.collection import Collection, sample_shape, turned_alike
from meshdeform.kinds.families.inference import Inference
from meshdeform.kinds.families.matching import (
    correspondences,
    descriptors,
    strangers,
    triangle_parts,
    unlike,
    unrelated,
)


def dense_matches(inference: Inference, source: int, target: int) -> torch.Tensor:
    """The sample (P,) of shape `target` that corresponds to each sample of shape `source`.

    A sample moves as the template points do that it corresponds to; the nearest sample of the same part is its match.
    """
    q = inference._matched(inference._scores(source), source)[0]
    moved = inference.boxed[source] + q @ (inference.deformed[target] - inference.deformed[source])
    part = [inference.parts[t].argmax(1) for t in (source, target)]
    distance = torch.cdist(moved, inference.boxed[target])
    return (distance + 1.0 * (part[0][:, None] != part[1])).argmin(1)


def sampled(name, count, samples, **more):
    members, shapes, truth = family(name, count, **more), [], []
    for number, member in enumerate(members):
        surface = load_asset(member.glb(), member.name).surface
        shape = sample_shape(surface.positions, surface.triangles, samples, number)
        shapes.append(shape)
        truth.append(np.array([PARTS[name].index(part) for part in member.parts()])[shape.triangles])
    return members, shapes, torch.from_numpy(np.stack(truth))


def stacked(shapes):
    points, normals = (
        torch.from_numpy(np.stack([getattr(s, n) for s in shapes])).float() for n in ("points", "normals")
    )
    return points, normals, torch.stack([s.features for s in shapes]), torch.stack([s.neighbours for s in shapes])


def test_parts_and_correspondences_are_found_from_few_labels():
    members, shapes, truth = sampled("chairs", 12, 160, kinds=("side", "armchair"))
    found = Collection.of(*stacked(shapes))
    given = torch.full_like(truth, -1)
    given[:4] = truth[:4]
    inference = Inference.start(found, given, 50, 4)
    before = inference.step()
    for _ in range(7):
        after = inference.step()
    assert after["log_likelihood"] > before["log_likelihood"]
    assert torch.equal(inference.parts[:4].argmax(2), truth[:4])
    assert (inference.parts[4:].argmax(2) == truth[4:]).float().mean() > 0.85
    # Crowded points pass samples on (the most is 4.0 times the mean otherwise), and only armchairs have arms.
    assert float(inference.mass.max()) < 3.2 * 160 / 50
    arms = correspondences(inference).exists[4:, inference.template.labels == PARTS["chairs"].index("arm")]
    assert arms[::2].mean() < 0.2
    assert arms[1::2].mean() > 0.8
    near = []
    for a, b in ((4, 6), (5, 7), (8, 11)):
        exact = (
            members[a].counterparts(members[b], shapes[a].triangles, shapes[a].weights) - shapes[b].centre
        ) / shapes[b].diagonal
        error = np.linalg.norm(shapes[b].points[dense_matches(inference, a, b)] - exact, axis=1)
        near += list(error[np.isfinite(error)] < 0.05)
    assert np.mean(near) > 0.6


def test_turned_shapes_are_turned_back_and_others_are_left_alone():
    _, shapes, _ = sampled("chairs", 12, 120)
    points = stacked(shapes)[0]
    assert not turned_alike(points).any()
    turned = points.clone()
    for t, quarter in ((0, 1), (5, 2), (9, 3)):
        angle = quarter * math.pi / 2
        x, z = points[t, :, 0], points[t, :, 2]
        turned[t, :, 0] = math.cos(angle) * x + math.sin(angle) * z
        turned[t, :, 2] = math.cos(angle) * z - math.sin(angle) * x
    back = turned_alike(turned)
    for t in range(12):
        assert float(back[t]) == pytest.approx({0: 1.5, 5: 1.0, 9: 0.5}.get(t, 0.0) * math.pi, abs=0.27)
    # Nose and tail of airplanes are alike: what fits a little better the other way round stays as it is.
    assert not turned_alike(stacked(sampled("airplanes", 16, 120)[1])[0]).any()


def test_triangles_take_the_part_of_samples_near_them_on_their_own_side():
    points = np.array([[0, 0, 0.0], [0, 0.01, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])
    up, down = [0, 1.0, 0], [0, -1.0, 0]
    parts = np.eye(3, dtype=np.float32)[[0, 1, 2, 2, 2]]
    found = triangle_parts(np.array([[0, 0, 0.0], [0, 0, 0], [2.1, 0, 0]]), np.array([down, up, up]), points,
                           np.array([down, up, up, up, up]), parts)  # fmt: skip
    assert found.tolist() == [0, 1, 2]


def test_what_is_far_from_the_others_is_of_another_family():
    random = torch.Generator().manual_seed(0)
    one = torch.randn(40, generator=random) * 0.4 + 9
    assert strangers(one) == []
    assert strangers(torch.cat([one, torch.tensor([2.0, 1.5, 2.2])])) == [40, 41, 42]
    assert strangers(torch.full((10,), 3.0)) == []
    # Sub-classes of one family differ as well: what is most of the collection is never the other family.
    assert strangers(torch.cat([one[:14] - 4.0, one[:6]])) == []

    # Where some are labelled, those tell. Eight shapes whose features lie around 0 or, a sub-class, around 1; the ninth
    # and tenth around 4 and 1.2.
    middle = torch.tensor([0.0, 0.1, 1.0, 1.1, 0.05, 0.0, 1.05, 1.0, 4.0, 1.2])
    features = middle[:, None, None] + torch.linspace(-1, 1, 30)[None, :, None] * torch.ones(1, 1, 3)
    features = features[:, torch.randperm(30, generator=torch.Generator().manual_seed(0))]
    labelled = torch.arange(10) < 5
    assert unlike(features, labelled) == [8]
    assert unlike(features, torch.arange(10) < 4) is None  # too few to tell
    assert unlike(features, labelled | (torch.arange(10) == 8)) == []  # what is labelled belongs
    # However much alike the labelled shapes are, others need not be as much alike.
    same = torch.zeros(10, 30, 3)
    same[9] = 0.1
    assert unlike(same, labelled) == []
    shapes = {name: sampled(name, 12, 60)[1] for name in PARTS}
    for name, other in (("bicycles", "chairs"), ("chairs", "airplanes"), ("airplanes", "bicycles")):
        both = stacked([*shapes[name], *shapes[other][:2]])[2]
        scaled = (both - both.mean((0, 1))) / both.std((0, 1))
        assert unlike(scaled, torch.arange(14) < 10) == [12, 13]


def test_descriptors_tell_places_and_existence_at_one_scale():
    random = np.random.default_rng(0)
    points, exists = random.normal(size=(6, 10, 3)), random.random((6, 10)) < 0.7
    exists[:2] = True
    points[1] = points[0]
    points[1, 3, 2] += 0.25
    found = descriptors(points, exists)
    assert found.shape == (6, 40)
    assert np.abs(found[0] - found[1]).sum() == pytest.approx(0.25, abs=1e-5)
    lacking = exists.copy()
    lacking[1, 3] = False
    apart = np.abs(descriptors(points[1:2], lacking[1:2], (points, exists)) - found[1:2]).sum()
    way = points[1, 3] - (points[:, 3] * exists[:, 3, None]).sum(0) / exists[:, 3].sum()
    assert apart == pytest.approx(0.8 + np.abs(way).sum(), abs=1e-5)


def test_what_has_little_in_common_is_no_family():
    chairs = stacked(sampled("chairs", 12, 120)[1])[2]
    mixed = torch.rand(12, 120, chairs.shape[2], generator=torch.Generator().manual_seed(0)) * 0.1
    mixed += 5 * torch.rand(12, 1, chairs.shape[2], generator=torch.Generator().manual_seed(1))
    mixed[3] += 20
    found = []
    for features in (chairs, mixed):
        scaled = (features - features.mean((0, 1))) / features.std((0, 1))
        found.append(unrelated(scaled))
    assert found[0][0] < 0.55 < found[1][0]
    assert found[0][1] == []
    assert found[1][1][0] == 3  # the farthest first
