"""The MCP server over streamable HTTP, behind the service's API keys, driven by the SDK's own client."""

from __future__ import annotations

import base64
import contextlib
import threading
from collections.abc import Callable, Iterator
from typing import Any

import anyio
import httpx
import httpx2
import uvicorn

from meshdeform.record.repository import JobRecord
from meshdeform.serving.stack import listen
from meshdeform.settings import Settings
from tests.acceptance.service import until
from tests.integration.conftest import new_job, serving_api
from tests.integration.http_calls import finished_job

WRONG_CALLS: list[tuple[dict[str, Any], str]] = [
    ({"asset": "a", "prompt": "a vase", "preset": "paper"}, "preset: there is no such argument. It is one of params."),
    ({"asset": "a", "prompt": "a vase", "parms": {}}, "parms: there is no such argument. Did you mean 'params'?"),
    ({"asset": "a"}, "prompt: Field required"),
    ({"asset": "a", "prompt": 3}, "prompt: Input should be a valid string"),
]


@contextlib.contextmanager
def mcp_server(service: str) -> Iterator[str]:
    from meshdeform.mcp.server import http_app

    listening = listen("127.0.0.1", 0)
    host = f"127.0.0.1:{listening.getsockname()[1]}"
    server = uvicorn.Server(uvicorn.Config(http_app(service, [host]), log_level="warning"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        until("the server has started", lambda: server.started)
        yield f"http://{host}/mcp"
    finally:
        server.should_exit = True
        thread.join()
        listening.close()


@contextlib.asynccontextmanager
async def agent(url: str, key: str) -> Any:
    from mcp import Client
    from mcp.client.streamable_http import streamable_http_client

    async with (
        httpx2.AsyncClient(headers={"Authorization": f"Bearer {key}"}, timeout=240) as http,
        Client(streamable_http_client(url, http_client=http)) as client,
    ):
        yield client


def test_agents_act_with_their_own_key_and_see_no_file_of_the_server(
    record: JobRecord, own_settings: Callable[..., Settings], sphere: bytes
) -> None:
    owner, key = record.keys.create("studio")
    _, other = record.keys.create("other")
    nobodys = new_job(record).id
    with serving_api(own_settings(auth="on")) as api, mcp_server(api.url) as url:
        done = finished_job(api, sphere, owner.owner_id)
        hello = {"jsonrpc": "2.0", "id": 1, "method": "tools/list", "params": {}}
        for header in ({}, {"Authorization": "Bearer nonsense"}, {"Authorization": f"Basic {key}"}):
            answer = httpx.post(url, json=hello, headers=header)
            assert answer.status_code == 401
            assert answer.headers["www-authenticate"].startswith("Bearer")
        elsewhere = {"Authorization": f"Bearer {key}", "Host": "evil.example"}
        assert httpx.post(url, json=hello, headers=elsewhere).status_code in (403, 421)

        async def first() -> str:
            async with agent(url, key) as client:
                names = {tool.name for tool in (await client.list_tools()).tools}
                assert not {"download", "apply_strength"} & names
                listed = (await client.list_tools()).tools
                assert all(tool.input_schema["additionalProperties"] is False for tool in listed)
                for arguments, said in WRONG_CALLS:
                    wrong = await client.call_tool("deform", arguments)
                    assert wrong.is_error
                    assert said in wrong.content[0].text
                    assert "pydantic" not in wrong.content[0].text
                sent = {"filename": "sphere.glb", "data": base64.b64encode(sphere).decode()}
                asset = (await client.call_tool("upload_asset", sent)).structured_content["asset"]
                for path in ("/etc/hostname", "examples/sphere.glb"):
                    refused = await client.call_tool("deform", {"asset": path, "prompt": "a vase"})
                    assert refused.is_error
                    assert "no files of its own machine" in refused.content[0].text
                broken = await client.call_tool("upload_asset", {"filename": "a.glb", "data": "not base64!"})
                assert "not base64" in broken.content[0].text
                started = await client.call_tool("deform", {"asset": asset, "prompt": "a vase"})
                assert not started.is_error, started.content
                assert (await client.call_tool("wait", {"job_id": nobodys})).is_error
                link = (await client.call_tool("link", {"job_id": done})).structured_content["url"]
                fetched = httpx.get(link)  # by somebody without a key, as it stands
                assert (fetched.status_code, fetched.content) == (200, sphere)
                return str(started.structured_content["job_id"])

        async def second(job: str) -> None:
            async with agent(url, other) as client:
                refused = await client.call_tool("cancel", {"job_id": job})
                assert "not_found" in refused.content[0].text
                assert (await client.call_tool("list_jobs", {})).structured_content == {"jobs": []}

        job = anyio.run(first)
        anyio.run(second, job)
        found = api.http.get(f"/v1/jobs/{job}", headers={"Authorization": f"Bearer {key}"})
        assert found.json()["state"] == "queued"


def test_a_service_that_is_down_is_said_and_nothing_is_let_in() -> None:
    with mcp_server("http://127.0.0.1:9") as url:
        answer = httpx.post(url, json={}, headers={"Authorization": "Bearer x"})
    assert answer.status_code == 503
    assert "cannot be asked" in answer.json()["detail"]
