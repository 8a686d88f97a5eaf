"""What a result looks like, what broke of it, and what its source is taken for."""

from __future__ import annotations

import pytest
import torch

from meshdeform.assets import build_glb
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.quality import measure, measure_structure
from meshdeform.geometry.shapes import icosphere
from meshdeform.nouns.families import member
from meshdeform.priors import load_prior
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.recognition import Recognition, front_of, known_source, recognise
from meshdeform.runs.verdict import before, kept_structure, likeness, summarize
from tests.cases import each_case
from tests.unit.runs.jobs import finished, started
from training.judge.members import HELD_OUT, seeded
from training.shapes import box

WHOLE = {
    "asymmetry": 0.0,
    "flatness": None,
    "contacts": 0.0,
    "cut_share": 0.0,
    "flipped_faces": 0,
    "opened_junctions": 0,
}


def test_what_was_kept_is_measured_on_the_shapes() -> None:
    ball = icosphere(3)
    verts = ball.verts.clone()
    verts[0] *= -1.5
    result = TriangleMesh(verts, ball.faces)
    quality = measure(ball.verts.numpy(), ball.faces.numpy(), verts.numpy()).to_dict()
    assert kept_structure(ball, ball, {**quality, "self_intersections_added": None})["cut_share"] == 0
    structure = kept_structure(ball, result, quality)
    assert structure["cut_share"] == pytest.approx(quality["self_intersections_added"] / len(ball.faces))
    assert structure["cut_share"] > 0
    assert structure["flipped_faces"] == quality["flipped_faces"]
    assert structure.items() >= measure_structure(ball, result).to_dict().items()


# The report says whether a result looks like its prompt.


def test_a_shape_of_the_family_matches_its_prompt_and_no_other() -> None:
    part = member("giraffe", (), seeded(HELD_OUT, "giraffe", 2000))
    mesh = TriangleMesh(torch.from_numpy(part.verts), torch.from_numpy(part.faces))
    same, other = likeness(mesh, "a giraffe"), likeness(mesh, "a tall vase")
    assert same is not None
    assert other is not None
    assert (same["noun"], same["rank"], same["nouns"], same["matches"]) == ("giraffe", 1, 149, True)
    assert same["probability"] > same["next"]["probability"]
    assert other["noun"] == "vase"
    assert other["rank"] > 1
    assert other["next"] == {"noun": "giraffe", "probability": same["probability"]}
    assert other["matches"] is False
    assert set(same["judge"]) == {"id", "revision", "sha256"}


@each_case("guidance, carrier", [("sds", "auto"), ("sds", "surface"), ("target", "auto")])
def test_a_prompt_has_it_and_every_report_a_verdict(guidance: str, carrier: str) -> None:
    ball = icosphere(1)
    asset = build_glb(ball.verts.numpy(), ball.faces.numpy())
    prior = load_prior("builtin", device="cpu")
    params = {"guidance": guidance, "carrier": carrier}
    _, report = finished(started(asset, "a mushroom", steps=1, target=asset, prior=prior, **params))
    assert ("likeness" in report) == (guidance == "sds")
    assert set(report["verdict"]) == {"value", "reasons", "advice", "structure"}
    assert set(report["verdict"]["structure"]) >= {"asymmetry", "cut_share"}
    assert 0 <= report["quality"]["kept_share"] <= 1
    if guidance == "sds":
        assert report["likeness"]["noun"] == "mushroom"
        known = recognise(TriangleMesh(ball.verts.float().double(), ball.faces))
        assert report["likeness"]["before"] == before(summarize(known.nouns, "mushroom"))
        assert report["verdict"]["value"] == "doubtful"  # one step


# What a source is taken for, and what follows from it.


@each_case(
    ("joints", "person"),
    [
        (["Head", "UpperArm.L", "UpperLeg.L"], True),
        (["mixamorig:Head", "mixamorig:LeftForeArm", "mixamorig:LeftFoot"], True),
        (["Bip01 Head", "Bip01 L Hand", "Bip01 L Thigh"], True),
        (["Armature", "Head", "FrontUpLeg.R"], False),
        (["head", "arm.L", "leg.L", "Tail1"], False),
        (["TankTrack22.L", "Root"], False),
        ([], False),
    ],
)
def test_the_joints_of_a_person_say_what_the_shape_does_not(joints: list[str], person: bool) -> None:
    known = recognise(box(3), joints=joints)
    assert (known.noun == "person") is person
    assert not (person and (known.built or not known.sure))
    assert recognise(box(3), "chair", joints).noun == "chair"


@each_case(
    ("source", "nouns", "built"),
    [
        (Recognition("chair", 0.6), {"chair": 1.0}, True),
        (Recognition("chair", 0.4), {"chair": 1.0}, False),
        (Recognition("dog", 1.0), {"dog": 1.0}, False),
        (Recognition("dog", 0.8, {"dog": 0.8, "cat": 0.2}), {"dog": 1.0}, False),
        (
            Recognition("pig", 0.3, {"cow": 0.1, "pig": 0.3, "bus": 0.05, "dog": 0.2}),
            {"pig": 0.5, "dog": 1 / 3, "cow": 1 / 6},
            False,
        ),
        (Recognition("pig", 0.2, {"pig": 0.2, "dog": 0.1, "cow": 0.1, "bus": 0.09}), {}, False),
        (Recognition("", 0.0), {}, False),
    ],
)
def test_a_source_may_be_several_things_by_their_probabilities(
    source: Recognition, nouns: dict[str, float], built: bool
) -> None:
    if len(nouns) != 1 or source.noun == "dog":
        assert source.likely() == pytest.approx(nouns)
    assert source.built is built


@each_case(
    "source, prompt, expected",
    [
        (Recognition("dog", 0.7), "a giraffe", (False, False, True, False, False)),
        (Recognition("dog", 0.8), "", (True, False, False, False, False)),
        (Recognition("bottle", 0.9), "a tall vase", (True, True, False, False, True)),
        (Recognition("bottle", 0.9), "a leaning vase", (True, True, False, True, True)),
    ],
)
def test_nobody_is_asked_for_the_front_of_what_is_not_recognised(
    source: Recognition, prompt: str, expected: tuple[bool, ...]
) -> None:
    prior, params = load_prior("builtin", device="cpu"), resolve(DeformParams())
    front = front_of(source, prior, params, prompt)
    assert front is not None
    assert (front.grader is not None, front.built, front.grown, front.crooked, front.turned) == expected
    kept = resolve(DeformParams.model_validate({"guidance": {"orientation": "keep"}}))
    assert known_source(icosphere(1), prior, kept) is known_source(icosphere(1), None, params) is None
    assert front_of(None, prior, params, prompt) is None
