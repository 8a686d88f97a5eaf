"""`meshdeform serve`, and its parts apart: `meshdeform api`, `meshdeform worker`."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path
from typing import Annotated

import typer

from meshdeform.commands.environment import load_settings, require
from meshdeform.commands.exits import clean_errors
from meshdeform.errors import ParameterError

__all__ = ["api", "serve", "worker"]

# The same as in meshdeform.stack, which a command imports when it runs.
_HOST, _PORT = "127.0.0.1", 8765
_API_GRACE_S = 10

_HostOption = Annotated[str, typer.Option(help="Address to listen on.")]
_PortOption = Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")]


@clean_errors
def serve(
    host: _HostOption = _HOST,
    port: _PortOption = _PORT,
    data_dir: Annotated[
        Path | None,
        typer.Option(help="Folder for everything that is kept (MESHDEFORM_DATA_DIR; default: meshdeform-data)."),
    ] = None,
    model: Annotated[str | None, typer.Option(help="Diffusion prior where a job names none.")] = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.")] = None,
    threads: Annotated[int | None, typer.Option(min=0, help="CPU threads of the worker; 0: all cores.")] = None,
) -> None:
    """Run the whole service: API, worker and queue. Ctrl-C stops all of it; the next start goes on where it stopped."""
    from meshdeform.stack import Stack

    settings = load_settings(data_dir=data_dir, model=model, device=device, threads=threads)
    require("fastapi", "service")
    require("torch", "worker")
    stack = Stack(
        settings,
        host=host,
        port=port,
        announce=lambda url: typer.echo(f"Meshdeform is ready: {url} (API: {url}/docs, stop: Ctrl-C)"),
        log=lambda line: typer.echo(line, err=True),
    )
    stack.run()


@clean_errors
def api(
    host: _HostOption = _HOST,
    port: _PortOption = _PORT,
    access_log: Annotated[bool, typer.Option(help="Log every request.")] = False,
    fd: Annotated[int | None, typer.Option(hidden=True)] = None,
) -> None:
    """Run the HTTP API alone; MESHDEFORM_REDIS_URL says where the queue is."""
    require("fastapi", "service")
    import uvicorn

    from meshdeform.stack import listen

    _require_redis()
    listening = listen(host, port) if fd is None else socket.socket(fileno=fd)
    config = uvicorn.Config(
        "service.app:create_app",
        factory=True,
        access_log=access_log,
        server_header=False,
        timeout_graceful_shutdown=_API_GRACE_S,
    )
    # uvicorn raises the signal that stopped it once more when it is done; a clean stop shall be exit code 0.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    uvicorn.Server(config).run(sockets=[listening])


@clean_errors
def worker() -> None:
    """Run a worker alone, one for each GPU; MESHDEFORM_REDIS_URL says where the queue is."""
    from meshdeform.processes import python_command

    _require_redis()
    require("torch", "worker")
    command = python_command("worker")
    os.execv(command[0], command)  # noqa: S606 - signals must reach the supervisor itself


def _require_redis() -> None:
    if not load_settings().redis_url:
        raise ParameterError(
            "MESHDEFORM_REDIS_URL is not set.",
            advice="Set it to the Redis of the queue, or run everything at once with `meshdeform serve`.",
        )
