"""Build the server: the tools, the two ways to reach it, and the check of its callers' API keys."""

from __future__ import annotations

import hashlib
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.transport_security import TransportSecuritySettings
from mcp.types import ToolAnnotations
from pydantic import ValidationError
from starlette.datastructures import Headers
from starlette.responses import JSONResponse

import meshdeform
from meshdeform.client import AsyncClient
from meshdeform.errors import ForbiddenError, MeshdeformError, UnauthorizedError
from meshdeform.mcp.tools import Folders, Tools, explained
from meshdeform.requests.groups import GROUPS
from meshdeform.requests.problems import did_you_mean, reason

if TYPE_CHECKING:
    from mcp.server.mcpserver.tools import Tool
    from starlette.types import ASGIApp, Receive, Scope, Send

_INSTRUCTIONS = """\
Meshdeform reshapes 3D assets: the same GLB comes out with a new shape; topology, UVs, materials and rig are kept.
Usual order: list_models (which words a model knows), validate, deform, wait, preview (look at it), download.
deform and fit_to_mesh return at once; wait returns when the job has finished. A job takes seconds to minutes.
If the result goes too far or not far enough, apply_strength changes that without a new job."""

_READS = ("list_models", "inspect_asset", "validate", "wait", "list_jobs", "preview", "link")
_STARTS = ("deform", "fit_to_mesh")
_WRITES = ("apply_strength", "download")
# Base64 adds a third, and the message around it a little.
_BODY_BYTES = 48 * 2**20
_REMEMBERED_S = 30.0
_MOST_REMEMBERED = 1000


class _Server(MCPServer):
    """Refuses arguments that a tool does not have, and says what is wrong with the others in plain words."""

    async def call_tool(self, name: str, arguments: dict[str, Any], context: Context[Any, Any] | None = None) -> Any:
        """Call a tool; `ToolError`: it cannot be called like that, or has failed."""
        try:
            return await super().call_tool(name, arguments, context)
        except ToolError as error:
            if isinstance(error.__cause__, ValidationError):
                raise ToolError(f"{name}: {self._said(name, error.__cause__)}") from error
            raise

    def _said(self, name: str, refused: ValidationError) -> str:
        tool = self._tool_manager.get_tool(name)
        known = tool.fn_metadata.arg_model.model_fields if tool else {}
        found = []
        for finding in refused.errors(include_url=False):
            location = ".".join(map(str, finding["loc"]))
            text = reason(finding)
            if finding["type"] == "extra_forbidden":
                text = did_you_mean(location, known, "argument")
                if location in GROUPS and "params" in known:
                    text = "there is no such argument. It is one of params."
            found.append(f"{location}: {text}")
        return "; ".join(found)


def _server(tools: Tools, names: Sequence[str]) -> MCPServer:
    server = _Server(
        "meshdeform",
        title="Meshdeform",
        instructions=_INSTRUCTIONS,
        version=meshdeform.__version__,
        log_level="WARNING",
    )
    for name in names:
        reads = name in _READS
        server.add_tool(
            explained(getattr(tools, name)),
            annotations=ToolAnnotations(
                read_only_hint=reads, destructive_hint=name == "cancel", idempotent_hint=reads, open_world_hint=False
            ),
        )
        _close(server._tool_manager.get_tool(name))
    return server


def _close(tool: Tool | None) -> None:
    """Let a tool refuse arguments that it does not have, and say so in its schema: the library drops them silently."""
    assert tool is not None
    model = tool.fn_metadata.arg_model
    model.model_config["extra"] = "forbid"
    model.model_rebuild(force=True)
    tool.parameters = model.model_json_schema(by_alias=True)


def local_server(url: str, api_key: str | None, roots: Sequence[Path]) -> MCPServer:
    """Return the server for an agent on this machine, over standard input and output.

    Its tools may read and write files in the folders `roots`.
    """

    @asynccontextmanager
    async def connect(_: Context) -> AsyncIterator[AsyncClient]:
        async with AsyncClient(url, api_key=api_key) as client:
            yield client

    tools = Tools(connect, Folders(roots))
    return _server(tools, [*_READS, *_STARTS, "cancel", *_WRITES])


def http_app(url: str, hosts: Sequence[str]) -> ASGIApp:
    """Return the application for agents elsewhere, over streamable HTTP at `/mcp`.

    Every caller sends the service's API key as a bearer token, with which its tools act. Files come by `upload_asset`
    and leave by `link`: no path of this machine is read or written. Other `Host` headers than `hosts`, such as
    `127.0.0.1:*`, are refused, against DNS rebinding.
    """

    @asynccontextmanager
    async def connect(ctx: Context) -> AsyncIterator[AsyncClient]:
        # An empty key, so that the key in this server's environment is nobody's.
        async with AsyncClient(url, api_key=_bearer(ctx.headers or {}) or "") as client:
            yield client

    tools = Tools(connect, Folders([]))
    server = _server(tools, [*_READS, *_STARTS, "cancel", "upload_asset"])
    origins = [f"{scheme}://{host}" for host in hosts for scheme in ("http", "https")]
    security = TransportSecuritySettings(allowed_hosts=list(hosts), allowed_origins=origins)
    # Without sessions, no caller can continue another one's.
    app = server.streamable_http_app(
        stateless_http=True, transport_security=security, max_request_body_size=_BODY_BYTES
    )
    return _KeyCheck(app, url)


def _bearer(headers: Mapping[str, str]) -> str | None:
    """Return the token of an `Authorization: Bearer` header, or None."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() or None if scheme.lower() == "bearer" else None


class _KeyCheck:
    """Answer 401 to callers without a key that the service accepts, before anything of their message is read."""

    # A key that was accepted is asked for again after 30 seconds; each call of a tool uses it at the service anyway.

    def __init__(self, app: ASGIApp, url: str) -> None:
        self._app = app
        self._url = url
        self._accepted: dict[bytes, float] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it."""
        if scope["type"] == "http":
            refusal = await self._refusal(_bearer(Headers(scope=scope)) or "")
            if refusal is not None:
                await refusal(scope, receive, send)
                return
        await self._app(scope, receive, send)

    async def _refusal(self, key: str) -> JSONResponse | None:
        name = hashlib.sha256(key.encode()).digest()
        if self._accepted.get(name, 0.0) > time.monotonic():
            return None
        try:
            async with AsyncClient(self._url, api_key=key, timeout_s=10.0, max_retries=0) as client:
                await client.limits()
        except (UnauthorizedError, ForbiddenError):
            detail = "Send an API key of the Meshdeform service as a bearer token."
            return JSONResponse({"detail": detail}, 401, {"WWW-Authenticate": 'Bearer realm="meshdeform"'})
        except (MeshdeformError, ValueError) as error:
            return JSONResponse({"detail": f"The Meshdeform service cannot be asked: {error}"}, 503)
        if len(self._accepted) >= _MOST_REMEMBERED:
            self._accepted.clear()
        self._accepted[name] = time.monotonic() + _REMEMBERED_S
        return None
