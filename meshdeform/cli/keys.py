"""`meshdeform keys`: the API keys on the record that the settings name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import JsonOption
from meshdeform.cli.output import emit, plain

if TYPE_CHECKING:
    from meshdeform.record.keys import ApiKey, KeyRing

__all__ = ["keys"]

keys = typer.Typer(help="Make, list and revoke the API keys of a service.", no_args_is_help=True)

_DataDirOption = Annotated[
    Path | None, typer.Option(help="Folder of the service (MESHDEFORM_DATA_DIR; default: meshdeform-data).")
]


@keys.command()
@clean_errors
def create(
    owner: Annotated[
        str, typer.Option(help="Whose jobs it sees and makes: lower-case letters, digits, - and _. Keys may share one.")
    ],
    name: Annotated[str, typer.Option(help="What it is for; for people.")] = "",
    requests_per_minute: Annotated[
        int | None, typer.Option(min=0, help="Requests in a minute; 0: any. Default: MESHDEFORM_REQUESTS_PER_MINUTE.")
    ] = None,
    max_active_jobs: Annotated[
        int | None, typer.Option(min=0, help="Unfinished jobs; 0: any. Default: MESHDEFORM_MAX_ACTIVE_JOBS.")
    ] = None,
    max_priority: Annotated[
        int | None, typer.Option(min=-100, max=100, help="Highest priority of jobs. Default: MESHDEFORM_MAX_PRIORITY.")
    ] = None,
    data_dir: _DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make a key and print it, once."""
    with _ring(data_dir) as ring:
        key, text = ring.create(owner, name, requests_per_minute, max_active_jobs, max_priority)
    if as_json:
        emit({**_document(key), "key": text})
        return
    typer.echo(text)
    typer.echo("This is the only time that the key is shown: keep it where secrets are kept.", err=True)
    typer.echo(f"Requests send it as: Authorization: Bearer KEY. To end it: meshdeform keys revoke {key.id}", err=True)


@keys.command(name="list")
@clean_errors
def list_(
    owner: Annotated[str | None, typer.Option(help="Only this owner's.")] = None,
    data_dir: _DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print all keys, oldest first; their secrets are kept nowhere."""
    with _ring(data_dir) as ring:
        found = ring.list(owner)
    if as_json:
        emit([_document(key) for key in found])
        return
    for key in found:
        state = "revoked" if key.revoked_at else "active"
        used = f"last used {key.last_used_at:%Y-%m-%d %H:%M} UTC" if key.last_used_at else "never used"
        typer.echo(plain("  ".join(filter(None, [key.id, key.owner_id, state, used, key.name]))))


@keys.command()
@clean_errors
def revoke(
    key_id: Annotated[str, typer.Argument(metavar="ID", help="The key's id, as `list` prints it: mdk_...")],
    data_dir: _DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """End a key for good. Services that run refuse it within 5 seconds."""
    # Who has the whole key at hand may give that; only the id is used.
    with _ring(data_dir) as ring:
        key = ring.revoke(key_id.partition(".")[0])
    if as_json:
        emit(_document(key))
        return
    typer.echo(f"{key.id} of {key.owner_id} is revoked.")


@contextmanager
def _ring(data_dir: Path | None) -> Iterator[KeyRing]:
    require("sqlalchemy", "service")
    from meshdeform.record.database import Database
    from meshdeform.record.keys import KeyRing

    database = Database(load_settings(data_dir=data_dir).resolved_database_url)
    try:
        yield KeyRing(database)
    finally:
        database.close()


def _document(key: ApiKey) -> dict[str, Any]:
    def instant(name: str) -> str | None:
        moment = getattr(key, name)
        return moment.isoformat() if moment is not None else None

    return {
        "id": key.id,
        "owner_id": key.owner_id,
        "name": key.name,
        "created_at": instant("created_at"),
        "last_used_at": instant("last_used_at"),
        "revoked_at": instant("revoked_at"),
        "requests_per_minute": key.requests_per_minute,
        "max_active_jobs": key.max_active_jobs,
        "max_priority": key.max_priority,
    }
