"""`meshdeform fetch`: save the artifacts of a job."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
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
            help="Only this artifact; repeatable. Default: all. morph.glb, result.obj.zip and result.stl "
            "are made if needed.",
            autocompletion=_complete_names,
            show_default=False,
        ),
    ] = None,
    step: Annotated[
        int | None,
        typer.Option(min=0, help="Instead: the shape at this checkpoint, as step-N.glb.", show_default=False),
    ] = None,
    asset: Annotated[bool, typer.Option("--asset", help="Instead: the asset as it was submitted.")] = False,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Save the artifacts of a job.

    Each file is verified against its SHA-256 before it appears; a file that is already there is not downloaded again.

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --name result.glb --name morph.glb

    meshdeform fetch job_01kg9zqk2xf3v8c5m7n9p1r4t6 -o mushroom --step 100
    """
    if (step is not None) + asset + bool(name) > 1:
        raise typer.BadParameter("give only one of --name, --step and --asset")
    folder = output or Path(job_id)
    with connect(url, api_key, api_key_file) as client:
        job = client.get(job_id)
        if not (asset or step is not None or job.state.terminal):
            note(f"The job is {job.state}: more artifacts may follow.", quiet=quiet)
        if asset:
            files = [_save_one(folder / _safe_name(job.asset.filename), partial(client.download_asset, job_id))]
        elif step is not None:
            files = [_save_one(folder / f"step-{step}.glb", partial(client.download_checkpoint, job_id, step))]
        else:
            files = save_artifacts(client, job_id, folder, name)
    if as_json:
        emit({"job_id": job_id, "files": files})
    elif not quiet:
        typer.echo("\n".join(path_lines(files)))


def _safe_name(filename: str) -> str:
    """Return the last part of a file name that a client sent, which may hold anything."""
    name = plain(filename.replace("\\", "/").rpartition("/")[2]).strip()
    return name if name not in ("", ".", "..") else "asset"


def _save_one(path: Path, download: Callable[[Path], Path]) -> dict[str, Any]:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        download(path)
        data = path.read_bytes()
    except OSError as error:
        raise _not_writable(path.parent, error) from error
    return {"name": path.name, "path": str(path), "size": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def _not_writable(folder: Path, error: OSError) -> UnavailableError:
    return UnavailableError(
        f"{folder} cannot be written: {error.strerror or error}.", advice="Choose another folder with -o."
    )


def save_artifacts(client: Client, job_id: str, folder: Path, names: list[str] | None = None) -> list[dict[str, Any]]:
    """Save a job's artifacts into a folder and return name, path, size in bytes and SHA-256 of each.

    Those that can still be made are made if they are named.

    Raises
    ------
    NotFoundError
        The job has no artifact of such a name.
    UnavailableError
        The folder cannot be written, or the service does not respond.
    """
    from meshdeform.client.downloads import AFTERWARDS

    known = {artifact.name: artifact for artifact in client.artifacts(job_id)}
    missing = [name for name in names or [] if name not in known]
    for name in [name for name in missing if known and name in AFTERWARDS]:
        known[name] = client.make(job_id, name)
        missing.remove(name)
    if missing:
        has = f"It has {', '.join(known)}." if known else "It has none yet."
        raise NotFoundError(f"The job {job_id} has no {', '.join(missing)}.", advice=has)
    if not known:
        raise NotFoundError(f"The job {job_id} has no artifacts.", advice="Only a job that succeeded has results.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = client.fetch(job_id, folder, names)
    except OSError as error:
        raise _not_writable(folder, error) from error
    return [
        {"name": path.name, "path": str(path), "size": known[path.name].size, "sha256": known[path.name].sha256}
        for path in paths
        if path.name in known
    ]


def path_lines(files: list[dict[str, Any]]) -> list[str]:
    """Return a line with the path of each file."""
    return [plain(file["path"]) for file in files]
