"""`params.control.parts`: what a request may say of an asset's parts."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from meshdeform.errors import ParameterError
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.requests.selection import MAX_PART_NAME, MAX_SELECTORS, check_selections
from tests.cases import each_case

PLACE = ("control", "parts")


def params(*parts: dict[str, Any]) -> DeformParams:
    return DeformParams.model_validate({"control": {"parts": list(parts)}})


def test_names_are_as_sentences_have_them() -> None:
    painted, joined = resolve(
        params({"name": " Left Ear_2 ", "faces": [3, [5, 9]]}, {"name": "Füße", "parts": ["B"]})
    ).parts
    assert (painted.name, painted.where) == ("left ear_2", ("faces", (3, (5, 9))))
    assert (joined.name, joined.parts, joined.named) == ("füße", ("b",), None)


@each_case(
    ("entry", "said"),
    [
        ({"name": "ears"}, "exactly one of"),
        ({"name": "ears", "faces": [1], "parts": ["horns"]}, "exactly one of"),
        ({"name": "ears", "node": "A", "material": "B"}, "exactly one of"),
        ({"faces": [1]}, "Field required"),
        ({"name": "", "faces": [1]}, "at least 1 character"),
        ({"name": "   ", "faces": [1]}, "at least 1 character"),
        ({"name": "e" * (MAX_PART_NAME + 1), "faces": [1]}, "at most 40 characters"),
        ({"name": "ears/left", "faces": [1]}, "letters, digits"),
        ({"name": "-ears", "faces": [1]}, "begins with"),
        ({"name": "ears", "parts": []}, "at least 1 item"),
        ({"name": "ears", "parts": ["a\nb"]}, "letters, digits"),
        ({"name": "ears", "faces": [1], "action": "keep"}, "Extra inputs"),
    ],
)
def test_an_entry_that_says_nothing_or_too_much_is_refused(entry: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        params(entry)


def test_there_are_at_most_as_many_as_selections_and_none_renames_what_another_does() -> None:
    entries = [{"name": f"part {number}", "faces": [number]} for number in range(MAX_SELECTORS)]
    assert len(params(*entries).control.parts) == MAX_SELECTORS
    with pytest.raises(ValidationError, match="at most 64 items"):
        params(*entries, {"name": "ears", "faces": [1]})
    with pytest.raises(ValidationError, match="horns gets a name twice"):
        params({"name": "ears", "parts": ["horns"]}, {"name": "crest", "parts": ["Horns"]})


def test_what_the_file_lacks_is_refused_before_the_job() -> None:
    file = {"nodes": [{"index": 0, "name": "Ear"}], "mesh_names": [], "materials": [], "joints": []}
    check_selections(PLACE, params({"name": "a", "node": "Ear"}, {"name": "b", "parts": ["c"]}).control.parts, file, 10)
    for entry in ({"node": "Nose"}, {"material": "Red"}, {"joint": {"name": "Head"}}, {"faces": [10]}):
        with pytest.raises(ParameterError) as caught:
            check_selections(PLACE, params({"name": "a", "faces": [1]}, {"name": "b", **entry}).control.parts, file, 10)
        assert caught.value.extra["errors"][0]["loc"] == ["params", "control", "parts", 1, next(iter(entry))]
