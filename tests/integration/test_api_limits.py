"""What a server allows: what it says about that, and that it holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform.settings import Settings
from tests.integration.conftest import Api, serving_api
from tests.integration.http_calls import check_document, check_problem, post


@pytest.fixture(scope="module")
def small(own_settings: Callable[..., Settings]) -> Iterator[Api]:
    """A server that allows little."""
    with serving_api(own_settings(max_steps=1000, max_run_s=60, max_upload_bytes=2**20, retention_s=3600)) as found:
        yield found


def test_a_server_says_what_it_allows(small: Api, openapi: dict[str, Any]) -> None:
    found = small.http.get("/v1/limits").json()
    check_document(found, "LimitList", openapi)
    assert found["files"]["max_bytes"] == found["uploads"]["max_bytes"] == 2**20
    assert found["jobs"]["max_steps"] == 1000
    assert (found["jobs"]["max_run_s"], found["jobs"]["max_running_jobs"]) == (60, None)
    assert found["jobs"]["default_retention_s"] == 3600


def test_more_steps_than_allowed_are_refused_also_where_the_preset_says_so(small: Api, sphere: bytes) -> None:
    for params in ({"steps": 1001}, {"preset": "paper"}):
        problem = check_problem(post(small, sphere, {"prompt": "a vase", "params": params}), 422, "parameter_invalid")
        assert (problem["limit"], problem["errors"][0]["loc"]) == (1000, ["params", "steps"])
    answer = post(small, sphere, {"prompt": "a vase", "params": {"steps": 1000}})
    assert answer.status_code == 202


def test_a_longer_run_than_allowed_is_refused(small: Api, sphere: bytes) -> None:
    problem = check_problem(post(small, sphere, {"prompt": "a vase", "max_run_s": 61}), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["max_run_s"]
    assert post(small, sphere, {"prompt": "a vase", "max_run_s": 60}).json()["max_run_s"] == 60
    assert post(small, sphere, {"prompt": "a vase"}).json()["max_run_s"] is None


# Which models a server has, over HTTP.


def test_the_models_of_a_server(
    own_settings: Callable[..., Settings], tmp_path: Path, openapi: dict[str, Any], sphere: bytes
) -> None:
    with serving_api(own_settings(model=str(tmp_path / "checkpoint"), allowed_models=["owner/other"])) as api:
        http = api.http
        answer = http.get("/v1/models")
        assert answer.status_code == 200, answer.text
        document = answer.json()
        check_document(document, "ModelList", openapi)
        assert document["default"] == "checkpoint"
        first, builtin, other = document["models"]
        assert (first["id"], first["available"], first["vocabulary"]) == (document["default"], False, None)
        assert first["problem"]
        assert (other["id"], other["available"]) == ("owner/other", False)
        assert (builtin["id"], builtin["available"], builtin["problem"]) == ("builtin", True, None)
        # What it says is understood is accepted; so the answer is of use to whoever writes a prompt.
        for prompt in builtin["vocabulary"]["examples"]:
            request = {"prompt": prompt, "params": {"guidance": {"model": "builtin"}}}
            sent = {"asset": ("sphere.glb", sphere), "request": (None, httpx.Response(200, json=request).content)}
            assert http.post("/v1/jobs:validate", files=sent).status_code == 200, prompt
