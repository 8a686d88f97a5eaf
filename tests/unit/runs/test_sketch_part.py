"""A drawing as the target of a job: what fits together, what it becomes, and what the report says."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from meshdeform.errors import ParameterError
from meshdeform.requests.document import JobRequest
from meshdeform.requests.sketches import SKETCH_FAMILIES, Sketch
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.runs.sketched_target import guessed
from meshdeform.runs.text_deform_kind import read_target
from meshdeform.settings import Settings
from meshdeform.sketch.members import member_glb
from tests.cases import each_case
from tests.drawings import drawing_of

VASE = {"family": "vase", "values": {"handles": "two"}}


def asked(**params: Any) -> JobRequest:
    return JobRequest.model_validate({"params": params})


def checked(*parts: str, **params: Any) -> Any:
    return check_request(asked(**params), Settings(), files=["asset", *parts])


def test_a_drawing_or_a_family_is_a_target() -> None:
    assert checked("sketch", guidance="target").guidance == "target"
    assert checked("sketch", sketch=VASE).guidance == "target"
    assert checked(sketch=VASE).sketch == Sketch.model_validate(VASE)


@each_case(
    ("parts", "params", "member"),
    [
        (["sketch"], {}, "guidance"),
        (["sketch", "target"], {"guidance": "target"}, "sketch"),
        (["target"], {"sketch": VASE}, "sketch"),
        ([], {"sketch": VASE, "guidance": "sds"}, "guidance"),
        ([], {"sketch": VASE, "silhouettes": [{"azimuth": 0}]}, "silhouettes"),
    ],
)
def test_what_contradicts_a_drawing_is_refused(parts: list[str], params: dict[str, Any], member: str) -> None:
    with pytest.raises(ParameterError) as caught:
        checked(*parts, **params)
    assert caught.value.extra["errors"][0]["loc"][:2] == ["params", member]


def test_parameters_are_checked_with_the_document() -> None:
    for wrong, words in (
        ({"family": "sofa"}, "no family 'sofa'"),
        ({"family": "vase", "values": {"legs": "four"}}, "no parameter 'legs'"),
        ({"family": "vase", "values": {"lip": 3}}, "from 0.08 to 0.3"),
        ({"family": "vase", "values": {"handles": "three"}}, "one of: none, one, two"),
    ):
        with pytest.raises(ValidationError, match=words):
            Sketch.model_validate(wrong)


def test_a_branch_takes_the_drawing_only_where_it_is_used() -> None:
    kind = kind_of(asked().kind)
    assert "sketch" in kind.inherits(asked(guidance="target"))
    assert "sketch" in kind.inherits(asked(sketch=VASE))
    assert "sketch" not in kind.inherits(asked())
    assert {"target", "sketch"} == set(kind.alternatives)


def test_corrections_replace_what_was_read() -> None:
    drawing = drawing_of("vase")
    first = guessed(drawing, None)
    assert first.family == "vase"
    assert first.values["handles"] == "none"
    corrected = guessed(drawing, Sketch.model_validate(VASE))
    assert corrected.values == {**first.values, "handles": "two"}
    named = guessed(drawing, Sketch(family="lamp"))
    assert (named.family, set(named.values)) == ("lamp", set(SKETCH_FAMILIES["lamp"].defaults()))


def test_the_target_is_shown_before_the_fit_and_described() -> None:
    shown: dict[str, bytes] = {}
    phases: list[str] = []
    given = RunInput(
        asked(sketch=VASE),
        {"asset": InputFile(b"", "a.glb")},
        on_phase=phases.append,
        on_artifact=lambda name, artifact: shown.update({name: artifact.data}),
    )
    target, about = read_target(given.request.params, given)
    assert phases == ["target"]
    assert shown == {"target.glb": member_glb("vase", {"handles": "two"})}
    assert target == InputFile(shown["target.glb"], "vase.glb")
    assert about == {"family": "vase", "values": SKETCH_FAMILIES["vase"].checked({"handles": "two"})}


def test_the_name_of_a_download_says_what_was_drawn() -> None:
    goal = kind_of(asked().kind).goal
    assert goal(asked(sketch=VASE), {"asset": "a.glb"}) == "like a vase"
    assert goal(asked(guidance="target"), {"asset": "a.glb", "sketch": "my lamp.png"}) == "like my lamp"
