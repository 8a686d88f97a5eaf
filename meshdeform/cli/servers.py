"""Run a service: `meshdeform serve`, its processes `api` and `worker`, its API keys, and tools for agents (`mcp`)."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, read_key, require, service_url
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import DataDirOption, JsonOption, Where, flag, option
from meshdeform.cli.output import emit, plain
from meshdeform.errors import ParameterError, readable_size
from meshdeform.serving import DEFAULT_HOST, DEFAULT_PORT

if TYPE_CHECKING:
    from meshdeform.record.database import Database
    from meshdeform.record.keys import ApiKey, KeyRing
    from meshdeform.settings import Settings

_HostOption = Annotated[str, option("Address to listen on.")]
_PortOption = Annotated[int, option("Port to listen on; 0 takes a free one.", min=0, max=65535)]
_NoAuthOption = Annotated[
    bool, flag("--no-auth", "Require no API key, whoever can reach the address (MESHDEFORM_AUTH=off).")
]
keys = typer.Typer(help="Create, list and revoke the API keys of a service.", no_args_is_help=True)


@clean_errors
def serve(
    host: _HostOption = DEFAULT_HOST,
    port: _PortOption = DEFAULT_PORT,
    data_dir: DataDirOption = None,
    model: Annotated[str | None, option("Diffusion model for jobs that name none.")] = None,
    device: Annotated[str | None, option("auto, cpu, cuda or cuda:N.")] = None,
    threads: Annotated[int | None, option("CPU threads of the worker; 0: all cores.", min=0)] = None,
    no_auth: _NoAuthOption = False,
    open_page: Annotated[bool, flag("--open", "Open the web page in the browser when it is ready.")] = False,
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
        bool | None, option("Log every request; the default if MESHDEFORM_LOG_FORMAT is json.")
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
        address, port_taken = listening.getsockname()[:2]
        emit({"event": "listening", "host": address, "port": port_taken, "pid": os.getpid()})
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
    from meshdeform.serving.access import check_origins, needs_keys

    check_origins(settings)
    # Required on every connection, loopback included.
    return settings.model_copy(update={"auth": "on"}) if needs_keys(settings.auth, host) else settings


def _require_key(settings: Settings, host: str, data_dir: Path | None) -> None:
    """Raise ParameterError if requests require a key and there is none."""
    # For a person at a terminal. The API alone is started by supervisors, which would start it again and again: it
    # starts without a key, lets nobody in, and says so.
    if _decided(settings, host).auth == "on" and not _has_key(settings):
        option = f" --data-dir {shlex.quote(str(data_dir))}" if data_dir is not None else ""
        reason = f"Others can reach {host}" if settings.auth == "auto" else "MESHDEFORM_AUTH is on"
        raise ParameterError(
            f"{reason}, so requests require an API key, and none exists.",
            advice=f"Create one: meshdeform keys create --owner me{option}. "
            "If a proxy in front of the service authenticates requests: --no-auth, or MESHDEFORM_AUTH=off.",
        )


def _has_key(settings: Settings) -> bool:
    url = settings.resolved_database_url
    if not settings.database_url and not Path(url.removeprefix("sqlite:///")).exists():
        return False  # opening the record would create it
    with _ring(settings) as ring:
        return ring.any_active()


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


@keys.command()
@clean_errors
def create(
    owner: Annotated[
        str,
        option("Whose jobs the key sees and creates: lower-case letters, digits, - and _. Keys may share an owner."),
    ],
    name: Annotated[str, option("A note on what the key is for.")] = "",
    requests_per_minute: Annotated[
        int | None, option("Requests per minute; 0: no limit. Default: MESHDEFORM_REQUESTS_PER_MINUTE.", min=0)
    ] = None,
    max_active_jobs: Annotated[
        int | None, option("Unfinished jobs; 0: no limit. Default: MESHDEFORM_MAX_ACTIVE_JOBS.", min=0)
    ] = None,
    max_priority: Annotated[
        int | None, option("Highest priority of jobs. Default: MESHDEFORM_MAX_PRIORITY.", min=-100, max=100)
    ] = None,
    data_dir: DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Create a key and print it, once."""
    with _ring(load_settings(data_dir=data_dir)) as ring:
        key, text = ring.create(owner, name, requests_per_minute, max_active_jobs, max_priority)
    if as_json:
        emit({**_document(key), "key": text})
        return
    typer.echo(text)
    typer.echo("The key is shown only this once: store it safely.", err=True)
    typer.echo(
        f"Requests send it as: Authorization: Bearer KEY. To revoke it: meshdeform keys revoke {key.id}", err=True
    )


@keys.command(name="list")
@clean_errors
def list_(
    owner: Annotated[str | None, option("Only keys of this owner.")] = None,
    data_dir: DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """List all keys, oldest first; their secrets are not stored."""
    with _ring(load_settings(data_dir=data_dir)) as ring:
        listed = ring.list(owner)
    if as_json:
        emit([_document(key) for key in listed])
        return
    for key in listed:
        state = "revoked" if key.revoked_at else "active"
        used = f"last used {key.last_used_at:%Y-%m-%d %H:%M} UTC" if key.last_used_at else "never used"
        typer.echo(plain("  ".join(filter(None, [key.id, key.owner_id, state, used, key.name]))))


@keys.command()
@clean_errors
def revoke(
    key_id: Annotated[str, typer.Argument(metavar="ID", help="The id of the key, as `list` prints it: mdk_...")],
    data_dir: DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Revoke a key permanently. Running services refuse it within 5 seconds."""
    # The whole key is accepted too; only its id is used.
    with _ring(load_settings(data_dir=data_dir)) as ring:
        key = ring.revoke(key_id.partition(".")[0])
    if as_json:
        emit(_document(key))
        return
    typer.echo(f"{key.id} of {key.owner_id} is revoked.")


@keys.command()
@clean_errors
def usage(
    owner: Annotated[str | None, option("Only this owner; empty: jobs without a key.")] = None,
    data_dir: DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print what owners have used, by month: jobs that ended, seconds of workers, bytes of results."""
    from meshdeform.record.usage import UsageLedger

    with _opened(load_settings(data_dir=data_dir)) as database:
        months = UsageLedger(database).months(owner)
    if as_json:
        emit([asdict(month) for month in months])
        return
    for month in months:
        amounts = f"{month.jobs:>8,} jobs  {month.seconds:>12,.1f} s  {readable_size(month.bytes):>10}"
        typer.echo(plain(f"{month.month}  {month.owner_id or '-':<24}  {amounts}"))


@contextmanager
def _ring(settings: Settings) -> Iterator[KeyRing]:
    with _opened(settings) as database:
        from meshdeform.record.keys import KeyRing

        yield KeyRing(database)


@contextmanager
def _opened(settings: Settings) -> Iterator[Database]:
    require("sqlalchemy", "service")
    from meshdeform.record.database import Database

    database = Database(settings.resolved_database_url)
    try:
        yield database
    finally:
        database.close()


def _document(key: ApiKey) -> dict[str, Any]:
    values = asdict(key)
    return {name: value.isoformat() if isinstance(value, datetime) else value for name, value in values.items()}


@clean_errors
def mcp(
    folder: Annotated[
        list[Path] | None,
        option(
            "A folder in which tools may read assets and write results; repeatable. Default: the current folder.",
            exists=True,
            file_okay=False,
        ),
    ] = None,
    http: Annotated[
        bool, flag("--http", "Serve streamable HTTP at /mcp in place of standard input and output.")
    ] = False,
    host: Annotated[str, option("With --http: address to listen on.")] = "127.0.0.1",
    port: Annotated[int, option("With --http: port; 0 takes a free one.", min=0, max=65535)] = 8766,
    allowed_host: Annotated[
        list[str] | None,
        option("With --http: a host name by which agents reach this server, with its port; repeatable."),
    ] = None,
    *,
    where: Where,
) -> None:
    """Offer a service to agents as tools (Model Context Protocol).

    An agent on this machine starts the command itself and speaks with it over standard input and output. With --http,
    agents elsewhere reach it, each with an API key of the service as bearer token.

    meshdeform mcp --folder assets
    """
    require("mcp", "mcp")
    address = service_url(where.url)
    if not http:
        from meshdeform.mcp.server import local_server

        local_server(address, read_key(where.api_key, where.api_key_file), folder or [Path.cwd()]).run("stdio")
        return
    if folder:
        raise typer.BadParameter("With --http, no folder of this machine is used.", param_hint="--folder")
    import uvicorn

    from meshdeform.mcp.server import http_app
    from meshdeform.serving.connections import LimitedProtocol
    from meshdeform.serving.stack import listen

    listening = listen(host, port)
    name, port_taken = listening.getsockname()[:2]
    shown = f"[{name}]" if ":" in name else name
    hosts = [f"{shown}:{port_taken}", f"localhost:{port_taken}", *(allowed_host or [])]
    typer.echo(f"MCP server for {address}: http://{shown}:{port_taken}/mcp (stop: Ctrl-C)")
    config = uvicorn.Config(http_app(address, hosts), http=LimitedProtocol, ws="none", log_level="warning")
    uvicorn.Server(config).run(sockets=[listening])
