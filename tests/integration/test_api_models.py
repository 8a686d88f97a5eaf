"""Which models a server has, over HTTP."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx

from meshdeform.settings import Settings
from tests.integration.conftest import serving
from tests.integration.http_calls import check_document


def test_the_models_of_a_server(redis_server_url: str, tmp_path: Path, openapi: dict[str, Any], sphere: bytes) -> None:
    settings = Settings(
        data_dir=tmp_path,
        redis_url=redis_server_url,
        queue=f"test-{tmp_path.name}",
        model=str(tmp_path / "checkpoint"),
        allowed_models=["owner/other"],
    )
    with serving(settings) as url, httpx.Client(base_url=url, timeout=30) as http:
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
