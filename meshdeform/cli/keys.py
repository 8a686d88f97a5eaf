"""`meshdeform keys`: create, list and revoke API keys in the record that the settings name."""

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

keys = typer.Typer(help="Create, list and revoke the API keys of a service.", no_args_is_help=True)

_DataDirOption = Annotated[
    Path | None, typer.Option(help="Folder of the service (MESHDEFORM_DATA_DIR; default: meshdeform-data).")
]


@keys.command()
@clean_errors
def create(
    owner: Annotated[
        str,
        typer.Option(
            help="Whose jobs the key sees and creates: lower-case letters, digits, - and _. Keys may share an owner."
        ),
    ],
    name: Annotated[str, typer.Option(help="A note on what the key is for.")] = "",
    requests_per_minute: Annotated[
        int | None,
        typer.Option(min=0, help="Requests per minute; 0: no limit. Default: MESHDEFORM_REQUESTS_PER_MINUTE."),
    ] = None,
    max_active_jobs: Annotated[
        int | None, typer.Option(min=0, help="Unfinished jobs; 0: no limit. Default: MESHDEFORM_MAX_ACTIVE_JOBS.")
    ] = None,
    max_priority: Annotated[
        int | None, typer.Option(min=-100, max=100, help="Highest priority of jobs. Default: MESHDEFORM_MAX_PRIORITY.")
    ] = None,
    data_dir: _DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Create a key and print it, once."""
    with _ring(data_dir) as ring:
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
    owner: Annotated[str | None, typer.Option(help="Only keys of this owner.")] = None,
    data_dir: _DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """List all keys, oldest first; their secrets are not stored."""
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
    key_id: Annotated[str, typer.Argument(metavar="ID", help="The id of the key, as `list` prints it: mdk_...")],
    data_dir: _DataDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Revoke a key permanently. Running services refuse it within 5 seconds."""
    # The whole key is accepted too; only its id is used.
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
