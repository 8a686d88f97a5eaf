"""`meshdeform serve`, and its processes one by one: `meshdeform api`, `meshdeform worker`."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import JsonOption
from meshdeform.cli.output import emit
from meshdeform.errors import ParameterError
from meshdeform.serving.defaults import DEFAULT_HOST, DEFAULT_PORT

if TYPE_CHECKING:
    from meshdeform.settings import Settings

__all__ = ["api", "serve", "worker"]

_HostOption = Annotated[str, typer.Option(help="Address to listen on.")]
_PortOption = Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")]
_NoAuthOption = Annotated[
    bool, typer.Option("--no-auth", help="Require no API key, whoever can reach the address (MESHDEFORM_AUTH=off).")
]


@clean_errors
def serve(
    host: _HostOption = DEFAULT_HOST,
    port: _PortOption = DEFAULT_PORT,
    data_dir: Annotated[
        Path | None,
        typer.Option(help="Folder for all stored data (MESHDEFORM_DATA_DIR; default: meshdeform-data)."),
    ] = None,
    model: Annotated[str | None, typer.Option(help="Diffusion model for jobs that name none.")] = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.")] = None,
    threads: Annotated[int | None, typer.Option(min=0, help="CPU threads of the worker; 0: all cores.")] = None,
    no_auth: _NoAuthOption = False,
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the web page in the browser when it is ready.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run the whole service: API, worker and queue.

    Ctrl-C stops all of it; the next start resumes unfinished jobs.

    meshdeform serve --data-dir meshdeform-data --port 8765
    """
    from meshdeform.serving.stack import Stack

    settings = load_settings(
        data_dir=data_dir, model=model, device=device, threads=threads, auth="off" if no_auth else None
    )
    require("fastapi", "service")
    require("torch", "worker")
    require("rq", "worker")

    def announce(url: str) -> None:
        page = f"{url}/" if settings.web == "on" else f"{url}/openapi.json"
        if as_json:
            emit({"event": "ready", "url": url, "page": page, "pid": os.getpid()})
        else:
            typer.echo(f"Meshdeform is ready: {page} (API: {url}/openapi.json, stop: Ctrl-C)")
        if open_page:
            _open_in_browser(page)

    _require_key(settings, host, data_dir)
    stack = Stack(
        _decided(settings, host),
        host=host,
        port=port,
        announce=announce,
        log=lambda line: typer.echo(line, err=True),
    )
    stack.run()


@clean_errors
def api(
    host: _HostOption = DEFAULT_HOST,
    port: _PortOption = DEFAULT_PORT,
    access_log: Annotated[
        bool | None, typer.Option(help="Log every request; the default if MESHDEFORM_LOG_FORMAT is json.")
    ] = None,
    no_auth: _NoAuthOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run the HTTP API alone; requires MESHDEFORM_REDIS_URL."""
    require("fastapi", "service")
    from meshdeform.serving.processes import python_command
    from meshdeform.serving.stack import listen

    _require_redis()
    settings = _decided(load_settings(auth="off" if no_auth else None), host)
    listening = listen(host, port)
    if as_json:
        address, taken = listening.getsockname()[:2]
        emit({"event": "listening", "host": address, "port": taken, "pid": os.getpid()})
    # The server reads its settings from the environment.
    os.environ["MESHDEFORM_AUTH"] = settings.auth
    listening.set_inheritable(True)
    logged = [] if access_log is None else ["--access-log" if access_log else "--no-access-log"]
    command = python_command("service", "--fd", str(listening.fileno()), *logged)
    os.execv(command[0], command)  # noqa: S606 - one process less, and the command line does not stay in memory


@clean_errors
def worker(as_json: JsonOption = False) -> None:
    """Run one worker alone, one for each GPU; requires MESHDEFORM_REDIS_URL."""
    from meshdeform.serving.processes import python_command

    _require_redis()
    require("torch", "worker")
    require("rq", "worker")
    command = python_command("worker")
    if as_json:
        emit({"event": "starting", "queue": load_settings().queue, "pid": os.getpid()})
    os.execv(command[0], command)  # noqa: S606 - signals must reach the supervisor itself


def _decided(settings: Settings, host: str) -> Settings:
    """Return the settings with `auth` decided by the address that the API listens on."""
    from meshdeform.serving.access import needs_keys

    # Required on every connection, loopback included.
    return settings.model_copy(update={"auth": "on"}) if needs_keys(settings.auth, host) else settings


def _require_key(settings: Settings, host: str, data_dir: Path | None) -> None:
    """Raise ParameterError if requests require a key and there is none.

    For a person at a terminal. The API alone is started by supervisors, which would start it again and again: it starts
    without a key, lets nobody in, and says so.
    """
    if _decided(settings, host).auth == "on" and not _has_key(settings):
        place = f" --data-dir {shlex.quote(str(data_dir))}" if data_dir is not None else ""
        reason = f"Others can reach {host}" if settings.auth == "auto" else "MESHDEFORM_AUTH is on"
        raise ParameterError(
            f"{reason}, so requests require an API key, and none exists.",
            advice=f"Create one: meshdeform keys create --owner me{place}. "
            "If a proxy in front of the service authenticates requests: --no-auth, or MESHDEFORM_AUTH=off.",
        )


def _has_key(settings: Settings) -> bool:
    require("sqlalchemy", "service")
    from meshdeform.record.database import Database
    from meshdeform.record.keys import KeyRing

    url = settings.resolved_database_url
    if not settings.database_url and not Path(url.removeprefix("sqlite:///")).exists():
        return False  # opening the record would create it
    database = Database(url)
    try:
        return KeyRing(database).any_active()
    finally:
        database.close()


def _open_in_browser(url: str) -> None:
    """Open a page in a thread, since some browsers return only when they are closed."""
    import threading
    import webbrowser

    def show() -> None:
        if not webbrowser.open(url):
            typer.echo(f"No browser could be opened. The page is at {url}", err=True)

    threading.Thread(target=show, daemon=True).start()


def _require_redis() -> None:
    if not load_settings().redis_url:
        raise ParameterError(
            "MESHDEFORM_REDIS_URL is not set.",
            advice="Set it to the Redis of the queue, or run everything with `meshdeform serve`.",
        )
