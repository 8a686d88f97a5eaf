"""Run a job of a kind that is no deformation, for its command and for `run --kind`."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.jobs import refuse_unused_options, run_on_service
from meshdeform.cli.local import run_here
from meshdeform.cli.options import Here, JobWhere, Printed
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import make_request
from meshdeform.errors import ParameterError
from meshdeform.requests.kind_folders import kind_table
from meshdeform.support.files import zipped


def run_kind(
    kind: str,
    params: Mapping[str, Any],
    files: Mapping[str, Path],
    output: Path,
    here: Here,
    where: JobWhere,
    printed: Printed,
    *,
    idempotency_key: str | None = None,
    **more: Any,
) -> None:
    """Run a job of a kind that is no deformation, here or on a service, and print its result.

    The files are by field; folders are packed. `more` are further members of the request.
    """
    request = make_request("", params, more={**more, "kind": kind})
    refuse_unused_options(where, here=here.written(), there=where.written())
    with tempfile.TemporaryDirectory(prefix="meshdeform-") as folder:
        sent = {field: packed(path, Path(folder)) for field, path in files.items()}
        if where.url:
            run_on_service(request, sent, where, output, printed, idempotency_key=idempotency_key)
            return
        require("scipy", "deform")
        paths, whole_folder = _outputs(kind, output, getattr(request.params, "level", 0))
        run = run_here(request, sent, paths, here, quiet=printed.quiet, whole_folder=whole_folder)
    print_result(kind, run, paths, printed)


def packed(path: Path, folder: Path) -> Path:
    """Return a file, or a ZIP in a temporary folder of the meshes in a folder."""
    from meshdeform.client.orders import files_in

    if path.is_file():
        return path
    try:
        files = files_in([path])
    except ValueError as error:
        raise ParameterError(str(error)) from error
    packed = folder / f"{path.resolve().stem}.zip"
    packed.write_bytes(zipped({name: file.read_bytes() for name, file in files.items()}))
    return packed


def _outputs(kind: str, output: Path, level: int) -> tuple[dict[str, Path], bool]:
    """Return the paths of artifacts, and whether they are all those of the kind, in a folder."""
    from meshdeform.runs import kind_of

    named = kind_table("commands", "OUTPUTS").get(kind, {})  # by ending; the first is written in any case
    if not named or not output.suffix or output.is_dir():
        return {artifact.name: output / artifact.name for artifact in kind_of(kind).artifacts}, True
    if output.suffix.lower() not in named:
        raise typer.BadParameter(
            f"{output.name} does not end in {' or '.join(named)}, and is no folder", param_hint="--output"
        )
    beside = {artifact: output.with_suffix(f".{artifact}") for artifact in ("report.json", "preview.png")}
    ending, main = next(iter(named.items()))
    chosen = {named[output.suffix.lower()].format(level=level): output}
    return {main: output.with_suffix(ending), **beside, **chosen}, False
