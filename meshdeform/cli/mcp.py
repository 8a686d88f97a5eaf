"""`meshdeform mcp`: offer a service to agents as tools of the Model Context Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshdeform.cli.environment import read_key, require, service_url
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import ApiKeyFileOption, ApiKeyOption, UrlOption

__all__ = ["mcp"]


@clean_errors
def mcp(
    folder: Annotated[
        list[Path] | None,
        typer.Option(
            help="A folder in which tools may read assets and write results; repeatable. Default: the current folder.",
            exists=True,
            file_okay=False,
        ),
    ] = None,
    http: Annotated[
        bool,
        typer.Option("--http", help="Serve streamable HTTP at /mcp in place of standard input and output."),
    ] = False,
    host: Annotated[str, typer.Option(help="With --http: address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="With --http: port; 0 takes a free one.")] = 8766,
    allowed_host: Annotated[
        list[str] | None,
        typer.Option(help="With --http: a host name by which agents reach this server, with its port; repeatable."),
    ] = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
) -> None:
    """Offer a service to agents as tools (Model Context Protocol).

    An agent on this machine starts the command itself and speaks with it over standard input and output. With --http,
    agents elsewhere reach it, each with an API key of the service as bearer token.

    meshdeform mcp --folder assets
    """
    require("mcp", "mcp")
    address = service_url(url)
    if not http:
        from meshdeform.mcp.server import local_server

        local_server(address, read_key(api_key, api_key_file), folder or [Path.cwd()]).run("stdio")
        return
    if folder:
        raise typer.BadParameter("With --http, no folder of this machine is used.", param_hint="--folder")
    import uvicorn

    from meshdeform.mcp.server import http_app
    from meshdeform.serving.stack import listen

    listening = listen(host, port)
    name, taken = listening.getsockname()[:2]
    shown = f"[{name}]" if ":" in name else name
    hosts = [f"{shown}:{taken}", f"localhost:{taken}", *(allowed_host or [])]
    typer.echo(f"MCP server for {address}: http://{shown}:{taken}/mcp (stop: Ctrl-C)")
    config = uvicorn.Config(http_app(address, hosts), log_level="warning")
    uvicorn.Server(config).run(sockets=[listening])
