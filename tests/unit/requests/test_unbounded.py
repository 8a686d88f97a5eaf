"""Stored documents: what they mean is read as at the door, and no bound is in the way."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError

from meshdeform.errors import UnreadableJobError
from meshdeform.requests.document import (
    DeformParams,
    JobRequest,
    ResolvedParams,
    params_by_kind,
    read_stored,
    read_unbounded,
    resolve,
)
from meshdeform.requests.parameters import GUIDANCES, Control
from meshdeform.requests.removed import grouped
from meshdeform.runs import kinds
from tests.cases import each_case


def examples(model: type[BaseModel]) -> list[dict[str, Any]]:
    """Documents with one member each, as its documentation has them."""
    required = {
        name: field.examples[0] for name, field in model.model_fields.items() if field.is_required() and field.examples
    }
    if "kind" in model.model_fields and model.model_fields["kind"].is_required():
        required["kind"] = get_args(model.model_fields["kind"].annotation)[0]
    return [
        {**required, name: example} for name, field in model.model_fields.items() for example in field.examples or []
    ]  # fmt: skip


def test_what_the_door_takes_is_read_as_at_the_door() -> None:
    assert len(kinds()) == len(params_by_kind())
    seen = 0
    for model in (*params_by_kind().values(), *GUIDANCES.values(), Control, JobRequest):
        for document in examples(model):
            read, taken = read_unbounded(model, document), model.model_validate(document)
            assert read == taken
            assert read.model_fields_set == taken.model_fields_set
            assert read.model_dump(mode="json", exclude_unset=True) == taken.model_dump(mode="json", exclude_unset=True)
            seen += 1
    assert seen > 55


@each_case(
    "params",
    [
        {"steps": 10**9},
        {"learning_rate": 50.0},
        {"seed": -1},
        {"negative_prompt": "x" * 10_000},
        {"orientation": 720.0},
        {"regions": [{"node": "n" * 1000}] * 200},
        {"handles": [{"position": [0, 0, 0], "to": [0, 1, 0]}] * 500},
        {"prompts": [{"prompt": "p" * 5000, "weight": 1e9}]},
    ],
)
def test_bounds_are_for_the_door_alone(params: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        DeformParams.model_validate(grouped(params))
    read = read_stored({"prompt": "x" * 9000, "params": params, "priority": 10**6, "metadata": {"n" * 99: "v" * 999}})
    assert set(read.params.flat()) == set(params)
    assert read.params.model_dump(mode="json", exclude_unset=True).keys() == grouped(params).keys()
    # A worker resolves the request of a job from before values were stored.
    assert resolve(read.params).model_dump(mode="json", exclude_unset=True)
    assert read_unbounded(ResolvedParams, {**resolve(DeformParams()).model_dump(), "steps": 10**9}).steps == 10**9


@each_case(
    ("params", "reason"),
    [
        ({"wobble": 1}, "params.wobble: there is no such member"),
        ({"regions": [{"node": "Lid", "wobble": 1}]}, "params.control.regions.0.wobble: there is no such member"),
        ({"preset": "ultra"}, "params.preset: Input should be"),
        ({"steps": "many"}, "params.steps: Input should be a valid integer"),
        ({"guidance": "target", "align": "matrix"}, "params.guidance"),
        ({"regions": [{"node": "Lid", "material": "wood"}]}, "exactly one of"),
        ([], "params: Input should be a valid dictionary"),
    ],
)
def test_what_is_not_understood_is_said_with_its_place(params: Any, reason: str) -> None:
    with pytest.raises(UnreadableJobError) as refused:
        read_stored({"prompt": "a vase", "params": params})
    assert reason in refused.value.detail


@each_case("kind", ["image_deform", None, 3, {}, []])
def test_an_unknown_kind_is_no_kind_whatever_its_type(kind: Any) -> None:
    with pytest.raises(UnreadableJobError, match="no kind of job"):
        read_stored({"kind": kind, "params": {}})
