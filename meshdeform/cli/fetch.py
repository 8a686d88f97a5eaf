"""`meshdeform fetch`: save the artifacts of a job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.connection import connect
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import (
    ApiKeyFileOption,
    ApiKeyOption,
    JobIdArgument,
    JsonOption,
    QuietOption,
    UrlOption,
)
from meshdeform.cli.output import emit, note, plain
from meshdeform.errors import NotFoundError, UnavailableError

if TYPE_CHECKING:
    from meshdeform.client import Client

__all__ = ["fetch", "path_lines", "save_artifacts"]


def _complete_names(incomplete: str) -> list[str]:
    from meshdeform.runs import kinds

    names = dict.fromkeys(artifact.name for kind in kinds() for artifact in kind.artifacts)
    return [name for name in names if name.startswith(incomplete)]


@clean_errors
def fetch(
    job_id: JobIdArgument,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The folder; default: named after the job.", file_okay=False, show_default=False
        ),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this artifact; repeatable. Default: all.", autocompletion=_complete_names, show_default=False
        ),
    ] = None,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Save the artifacts of a job.

    Each file is verified against its SHA-256 before it appears; a file that is already there is not downloaded again.

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --name result.glb
    """
    folder = output or Path(job_id)
    with connect(url, api_key, api_key_file) as client:
        job = client.get(job_id)
        if not job.state.terminal:
            note(f"The job is {job.state}: more artifacts may follow.", quiet=quiet)
        files = save_artifacts(client, job_id, folder, name)
    if as_json:
        emit({"job_id": job_id, "files": files})
    elif not quiet:
        typer.echo("\n".join(path_lines(files)))


def save_artifacts(client: Client, job_id: str, folder: Path, names: list[str] | None = None) -> list[dict[str, Any]]:
    """Save a job's artifacts into a folder and return name, path, size in bytes and SHA-256 of each.

    Raises
    ------
    NotFoundError
        The job has no artifact of such a name.
    UnavailableError
        The folder cannot be written, or the service does not respond.
    """
    known = {artifact.name: artifact for artifact in client.artifacts(job_id)}
    if missing := [name for name in names or [] if name not in known]:
        has = f"It has {', '.join(known)}." if known else "It has none yet."
        raise NotFoundError(f"The job {job_id} has no {', '.join(missing)}.", advice=has)
    if not known:
        raise NotFoundError(f"The job {job_id} has no artifacts.", advice="Only a job that succeeded has results.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = client.fetch(job_id, folder, names)
    except OSError as error:
        raise UnavailableError(
            f"{folder} cannot be written: {error.strerror or error}.", advice="Choose another folder with -o."
        ) from error
    return [
        {"name": path.name, "path": str(path), "size": known[path.name].size, "sha256": known[path.name].sha256}
        for path in paths
        if path.name in known
    ]


def path_lines(files: list[dict[str, Any]]) -> list[str]:
    """Return a line with the path of each file."""
    return [plain(file["path"]) for file in files]
