"""`meshdeform batch`: deform many assets, locally or on a service; it can be interrupted and resumed at any time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import ExitCode, OutcomeError, clean_errors
from meshdeform.cli.form import of_kind, of_request, with_options, written
from meshdeform.cli.options import Printed, SetOption, Where, file_option, flag, option, output_option
from meshdeform.cli.output import emit, note, table
from meshdeform.cli.request import merge_params

if TYPE_CHECKING:
    from meshdeform.cli.batches.rows import Entry
    from meshdeform.requests.document import JobRequest

_WHAT, _HOW = "What", "How"
_ROWS_AT_SERVICE = 8


@clean_errors
@with_options(
    of_kind("text_deform"),
    of_request("output", _WHAT, only=("morph", "subdivide", "compact", "provenance")),
    usual="--output --prompt --seeds --preset --guidance --strength --set --retry-failed --url",
)
def batch(
    ctx: typer.Context,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST|FOLDER", help="A .csv, .tsv or .jsonl of rows, or a folder of assets.", exists=True
        ),
    ],
    output: Annotated[Path, output_option("The folder of the batch.", file_okay=False)],
    prompt: Annotated[
        list[str] | None, option("With a folder: what each asset should become; repeatable.", _WHAT)
    ] = None,
    prompts_file: Annotated[Path | None, file_option("A file of prompts, one per line.", _WHAT)] = None,
    seeds: Annotated[
        int | None, option("Run each row with this many seeds, which gives as many variations.", _WHAT, min=1)
    ] = None,
    as_morph_targets: Annotated[
        bool,
        flag("--as-morph-targets", "Also write the results of each asset as named morph targets of one file.", _WHAT),
    ] = False,
    settings: SetOption = None,
    parallel: Annotated[
        int | None, option("Rows at the same time; default: 1 locally, 8 on a service.", _HOW, min=1)
    ] = None,
    device: Annotated[str | None, option("Locally: auto, cpu, cuda or cuda:N.", _HOW)] = None,
    threads: Annotated[
        int | None, option("Locally: CPU threads per row; default: cores divided by rows.", _HOW, min=0)
    ] = None,
    retry_failed: Annotated[bool, flag("--retry-failed", "Retry rows that failed before.", _HOW)] = False,
    *,
    where: Where,
    printed: Printed,
) -> None:
    """Deform many assets.

    Runs on the service that --url or MESHDEFORM_URL names, else on this machine. Whatever stopped it, the same
    command does what is missing.

    meshdeform batch assets/ --prompt "a vase" --prompt "a mushroom" --seeds 3 -o out

    meshdeform batch rows.csv -o out --retry-failed
    """
    from meshdeform.cli.batches import runners
    from meshdeform.cli.batches.ledger import Ledger
    from meshdeform.cli.batches.rows import make_rows
    from meshdeform.cli.batches.session import Session, write_target_sets

    if as_morph_targets:
        require("scipy", "deform")
    entries = _entries(source, prompt or [], prompts_file)
    defaults = merge_params(ctx, settings)
    first = int(defaults.get("seed", 0))
    with Ledger(output) as ledger:
        session = Session(ledger, as_json=printed.as_json, quiet=printed.quiet)
        rows, repeated = make_rows(
            entries,
            defaults=defaults,
            seeds=range(first, first + seeds) if seeds else (),
            output=written(ctx, "output"),
            known_names=ledger.known_names(),
            check=(lambda request, _has_target: request) if where.url else _checker(),
        )
        if repeated:
            note(f"Duplicate rows are done once: {'; '.join(repeated)}", quiet=printed.quiet)
        if where.url:
            runner: runners.Runner = runners.ServiceRunner(where.connect(), ledger, output)
            concurrent = parallel or _ROWS_AT_SERVICE
        else:
            concurrent = min(parallel or 1, len(rows))
            share = {"device": device, "threads": threads if threads is not None else _share(concurrent)}
            runner = runners.LocalRunner(output, share)
        session.run(rows, runner, concurrent, retry_failed=retry_failed)
        counts, files = session.finish(rows)
        if as_morph_targets:
            files |= write_target_sets(output, rows, load_settings())
    if printed.as_json:
        emit({"event": "summary", "folder": str(output), "files": files, **counts})
    elif not printed.quiet:
        typer.echo(table(tuple(counts), [tuple(str(number) for number in counts.values())]))
        typer.echo("\n".join(files.values()))
    if counts["failed"]:
        raise OutcomeError(
            ExitCode.SOME_FAILED,
            "batch_incomplete",
            f"{counts['failed']} of {counts['rows']} rows failed.",
            f"The reasons are in {output / 'summary.csv'}. To retry them: the same command with --retry-failed.",
            **counts,
        )


def _entries(source: Path, prompts: Sequence[str], prompts_file: Path | None) -> list[Entry]:
    from meshdeform.cli.batches.rows import TABLE_SUFFIXES, combine, read_prompts, read_table

    prompts = [*prompts, *(read_prompts(prompts_file) if prompts_file else [])]
    if source.is_file() and source.suffix.lower() in TABLE_SUFFIXES:
        if prompts:
            raise typer.BadParameter("a manifest has its own prompts", param_hint="--prompt")
        return read_table(source)
    return combine(source, prompts)


def _checker() -> Any:
    """Return a check that refuses a row that cannot run on this machine, without importing torch.

    It returns the request with its kind of guidance; a service decides that itself.
    """
    require("scipy", "deform")
    from meshdeform.cli.local import check_locally
    from meshdeform.requests.default_kind import with_kind

    settings = load_settings()

    def check(request: JobRequest, has_target: bool) -> JobRequest:
        files = ["asset", "target"] if has_target else ["asset"]
        request = with_kind(request, settings.model, files)
        check_locally(request, settings, files)
        return request

    return check


def _share(parallel: int) -> int | None:
    """Return the CPU threads per row; None: those of the settings."""
    if parallel == 1:
        return None
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, cores // parallel)
