"""Unknown names of members: what is said of them, by the HTTP interface and by the command line alike."""

from __future__ import annotations

from typing import Any

import pytest

from meshdeform.cli.request import make_request
from meshdeform.errors import ParameterError
from meshdeform.requests.problems import did_you_mean
from tests.cases import each_case


def test_the_nearest_name_is_proposed_or_all_are_listed() -> None:
    assert did_you_mean("Stepz", ["seed", "steps"]) == "there is no such member. Did you mean 'steps'?"
    assert did_you_mean("xyz", ["b", "a"], "parameter") == "there is no such parameter. There are: a, b."
    assert did_you_mean("xyz", []) == "there is no such member. There are: none."


@each_case(
    ("params", "said"),
    [
        ({"stepz": 3}, "params.stepz: there is no such member. Did you mean 'steps'?"),
        ({"control": {"symetry": "x"}}, "params.control.symetry: there is no such member. Did you mean 'symmetry'?"),
        ({"stepz": 3, "seed": "a"}, "as an integer; params.stepz: there is no such member. Did you mean 'steps'?"),
    ],
)
def test_the_command_line_proposes_it(params: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError) as refused:
        make_request("a vase", params)
    assert refused.value.detail.endswith(said)
