"""`meshdeform mcp` as an agent on this machine starts it, driven by the SDK's own client."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio
import pytest

from meshdeform.requests.choices import Preset
from meshdeform.verdicts import Verdict
from tests.acceptance.cli import command, environment
from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service

if TYPE_CHECKING:
    from mcp import Client
    from mcp.types import CallToolResult

pytestmark = pytest.mark.acceptance


def text(answer: CallToolResult) -> str:
    (content,) = answer.content
    return str(getattr(content, "text", ""))


async def refused(client: Client, tool: str, arguments: dict[str, Any]) -> str:
    answer = await client.call_tool(tool, arguments)
    assert answer.is_error, text(answer)
    return text(answer)


async def found(client: Client, tool: str, arguments: dict[str, Any]) -> Any:
    answer = await client.call_tool(tool, arguments)
    assert not answer.is_error, text(answer)
    return answer.structured_content


def test_an_agent_goes_from_a_file_to_a_file(service: Service, tmp_path: Path) -> None:
    from mcp import Client, StdioServerParameters, stdio_client

    folder = tmp_path / "assets"
    folder.mkdir()
    write_ellipsoid(folder / "sphere.obj", 1.0)
    write_ellipsoid(folder / "egg.obj", 1.6)
    write_ellipsoid(tmp_path / "secret.obj", 1.0)
    (folder / "link.obj").symlink_to(tmp_path / "secret.obj")
    url = str(service.http.base_url).rstrip("/")
    first, *arguments = command("mcp", "--folder", folder, "--url", url)
    server = StdioServerParameters(command=first, args=arguments, env=environment())
    progress: list[float] = []

    async def told(done: float, total: float | None, message: str | None) -> None:
        progress.append(done)

    async def agent() -> None:
        async with Client(stdio_client(server)) as client:
            tools = {tool.name: tool for tool in (await client.list_tools()).tools}
            assert {"deform", "fit_to_mesh", "wait", "preview", "apply_strength", "download"} <= set(tools)
            assert "upload_asset" not in tools, "files of this machine have paths"
            assert all(tool.description for tool in tools.values())

            # Every preset that an agent is told of is one that the service takes, and none is kept from it.
            told_params = tools["deform"].input_schema["properties"]["params"]["description"]
            assert set(re.findall(r"`(\w+)`", told_params)) == set(Preset)
            for preset in Preset:
                wanted = {"asset": "sphere.obj", "prompt": "a vase", "params": {"preset": preset.value}}
                assert (await found(client, "validate", wanted))["params"]["preset"] == preset

            models = await found(client, "list_models", {})
            assert any(model["id"] == "builtin" for model in models["models"])
            shown = await found(client, "inspect_asset", {"asset": "egg.obj"})
            assert shown["components"][0]["triangles"] == shown["triangles"]

            unknown = {"asset": "sphere.obj", "prompt": "a quixotic zeitgeist"}
            assert "prompt_unknown_words" in await refused(client, "validate", unknown)
            for outside in ("../secret.obj", str(tmp_path / "secret.obj"), "link.obj"):
                assert "outside the folders" in await refused(client, "deform", {**unknown, "asset": outside})
            assert "There is no file" in await refused(client, "deform", {**unknown, "asset": "none.obj"})

            fit = {"asset": "sphere.obj", "target": "egg.obj", "params": {"steps": 4}}
            job = (await found(client, "fit_to_mesh", fit))["job_id"]
            answer = await client.call_tool("wait", {"job_id": job}, progress_callback=told)
            assert answer.structured_content is not None
            assert answer.structured_content["state"] == "succeeded"
            assert next(iter(answer.structured_content)) == "verdict"
            verdict = answer.structured_content["verdict"]
            assert verdict["value"] in list(Verdict)
            assert verdict["reasons"]
            assert bool(verdict["advice"]) is (verdict["value"] != Verdict.GOOD)
            assert progress == sorted(progress)
            assert progress[-1] == 1.0

            (picture,) = (await client.call_tool("preview", {"job_id": job})).content
            assert base64.b64decode(picture.data) == service.artifact(job, "preview.png")
            written = await found(client, "download", {"job_id": job, "path": "egg-from-sphere.glb"})
            assert Path(written["path"]).read_bytes() == service.artifact(job, "result.glb")
            again = {"job_id": job, "path": "egg-from-sphere.glb"}
            assert "exists already" in await refused(client, "download", again)
            assert "outside" in await refused(client, "download", {"job_id": job, "path": "../result.glb"})
            assert not (tmp_path / "result.glb").exists()
            half = await found(client, "apply_strength", {"job_id": job, "strength": 0.5, "path": "half.glb"})
            assert Path(half["path"]).read_bytes()[:4] == b"glTF"

            # The result of a job is an asset of the next one; an agent may give up waiting, and cancel.
            with service.held_jobs():
                more = {"asset": f"{job}/result.glb", "prompt": "a vase", "params": {"steps": 4}}
                next_job = (await found(client, "deform", more))["job_id"]
                waited = await found(client, "wait", {"job_id": next_job, "timeout_s": 0.1})
                assert waited["state"] in ("queued", "running")
                await found(client, "cancel", {"job_id": next_job})
            ended = await found(client, "wait", {"job_id": next_job})
            assert ended["state"] == "canceled"
            listed = await found(client, "list_jobs", {"search": "a vase", "limit": 1})
            assert [each["job_id"] for each in listed["jobs"]] == [next_job]

    anyio.run(agent)
