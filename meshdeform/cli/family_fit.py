"""`meshdeform family-fit`: find what a folder of assets of one family has in common, on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.family_folders import FolderJob, packed
from meshdeform.cli.options import JsonOption, QuietOption, SetOption
from meshdeform.cli.output import emit
from meshdeform.cli.request import make_request, merge_params

__all__ = ["family_fit"]


@clean_errors
def family_fit(
    collection: Annotated[
        Path, typer.Argument(help="A folder or a ZIP of 10 to 3,000 assets of one family.", exists=True, readable=True)
    ],
    labels: Annotated[
        Path | None,
        typer.Option(
            help="Parts of some of the assets (docs/families.md). Default: labels.json in the folder or ZIP.",
            exists=True,
            dir_okay=False,
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The folder to write. Default: NAME-family.", show_default=False),
    ] = None,
    points: Annotated[int | None, typer.Option(help="Number of template points; default: 500.")] = None,
    parts: Annotated[int | None, typer.Option(help="Number of parts without labels; default: 4.")] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; default: 0.")] = None,
    embed_labels: Annotated[
        bool, typer.Option("--embed-labels", help="Also write the assets with their parts, as labelled.zip.")
    ] = False,
    param: SetOption = None,
    threads: Annotated[int | None, typer.Option(min=0, help="CPU threads; 0: all cores.")] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(help="Save the state to this file regularly and at Ctrl-C.", dir_okay=False, show_default=False),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            help="Continue from a file that --checkpoint wrote.", exists=True, dir_okay=False, show_default=False
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that no earlier run wrote.")] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find the parts and the correspondences of a family of assets, and learn its shapes.

    meshdeform family-fit chairs/ --labels labels.json -o chairs-family
    """
    require("torch", "deform")
    settings = load_settings(threads=threads)
    output = output or Path(f"{collection.stem}-family")
    named = merge_params(param or [], points=points, parts=parts, seed=seed, embed_labels=embed_labels or None)
    from meshdeform.runs.family_fit_kind import FAMILY_FIT, params_of  # registers the kind, which make_request needs

    request = make_request("", named, more={"kind": "family_fit"})
    params = params_of(request)
    job = FolderJob(FAMILY_FIT, output, checkpoint, resume)
    job.check(force=force)
    from meshdeform.assets import Limits
    from meshdeform.runs.devices import use_threads

    limits = Limits.from_settings(settings)
    files = {"collection": (packed(collection, limits.max_bytes, labels), collection.name)}
    use_threads(settings.threads)
    found, report = job.carry_out(request, files, limits, params.checkpoint_every_steps, quiet=quiet)
    summary = found | {name: report[name] for name in ("accuracy", "classes", "strangers", "warnings")}
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    typer.echo(f"Folder     {output}")
    typer.echo(f"Files      {', '.join(summary['files'])}")
    typer.echo(f"Parts      {', '.join(report['parts'])}")
    if report["accuracy"]:
        found = report["accuracy"]
        typer.echo(f"Accuracy   {found['parts']:.1%} of the surface of {found['held_out']} held-out assets")
    if report["classes"]:
        typer.echo(f"Classes    {report['classes']['nearest_neighbour']:.1%} have a nearest neighbour of their class")
    for warning in report["warnings"]:
        typer.echo(warning, err=True)
