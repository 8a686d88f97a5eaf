"""`meshdeform family-synthesize`: make new assets of a fitted family, on this machine."""

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
from meshdeform.errors import ParameterError
from meshdeform.requests.choices import SynthesisMode

__all__ = ["family_synthesize"]

_FILE = "family.safetensors"


@clean_errors
def family_synthesize(
    family: Annotated[
        Path, typer.Argument(help="The folder that family-fit wrote, or its family.safetensors.", exists=True)
    ],
    collection: Annotated[
        Path | None,
        typer.Argument(
            help="The folder or ZIP that was fitted. Default: labelled.zip beside the family, if it is there.",
            exists=True,
            show_default=False,
        ),
    ] = None,
    mode: Annotated[
        SynthesisMode | None, typer.Option(help="What to make; default: sample.", show_default=False)
    ] = None,
    count: Annotated[int | None, typer.Option(help="Number of shapes, or of members found; default: 4.")] = None,
    member: Annotated[
        list[str] | None,
        typer.Option(help="A member: two for interpolate, one for complete and search.", show_default=False),
    ] = None,
    keep: Annotated[
        list[str] | None, typer.Option(help="A part that complete keeps as it is.", show_default=False)
    ] = None,
    rounds: Annotated[int | None, typer.Option(help="Rounds of Gibbs sampling; default: 10.")] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The folder to write. Default: NAME-shapes.", show_default=False),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; default: 0.")] = None,
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
    """Make new assets of a family out of parts of its members.

    meshdeform family-synthesize chairs-family chairs/ --count 8
    """
    require("torch", "deform")
    settings = load_settings(threads=threads)
    source, assets = _sources(family, collection)
    output = output or Path(f"{source.parent.name if family.is_dir() else source.stem}-shapes")
    named = merge_params(
        param or [],
        mode=str(mode) if mode else None,
        count=count,
        members=member,
        keep=keep,
        rounds=rounds,
        seed=seed,
    )
    from meshdeform.runs.family_synthesize_kind import FAMILY_SYNTHESIZE, params_of  # registers the kind

    request = make_request("", named, more={"kind": "family_synthesize"})
    params = params_of(request)
    job = FolderJob(FAMILY_SYNTHESIZE, output, checkpoint, resume)
    job.check(force=force)
    from meshdeform.assets import Limits
    from meshdeform.runs.devices import use_threads

    limits = Limits.from_settings(settings)
    files = {
        "family": (source.read_bytes(), source.name),
        "collection": (packed(assets, limits.max_bytes), assets.name),
    }
    use_threads(settings.threads)
    found, report = job.carry_out(request, files, limits, params.checkpoint_every_steps, quiet=quiet)
    summary = found | {name: report[name] for name in ("shapes", "nearest_members", "warnings")}
    if as_json:
        emit(summary)
        return
    if quiet:
        return
    typer.echo(f"Folder     {output}")
    typer.echo(f"Files      {', '.join(summary['files'])}")
    for shape in report["shapes"]:
        parts = ", ".join(f"{each['part']} of {each['member']}" for each in shape["parts"])
        typer.echo(f"{shape['name']}  {parts}; more plausible than {shape['plausibility']:.0%} of the members")
    for each in report["nearest_members"] or ():
        typer.echo(f"{each['distance']:9.3f}  {each['name']}")
    for warning in report["warnings"]:
        typer.echo(warning, err=True)


def _sources(family: Path, collection: Path | None) -> tuple[Path, Path]:
    """Return the family's file and the collection.

    Raises
    ------
    ParameterError
        One of them is not there.
    """
    source = family / _FILE if family.is_dir() else family
    if not source.is_file():
        raise ParameterError(
            f"There is no {_FILE} in {family}.", advice="Give the folder that meshdeform family-fit wrote."
        )
    assets = collection or source.parent / "labelled.zip"
    if not assets.exists():
        raise ParameterError(
            "The collection is missing.", advice="Give the folder or ZIP that was fitted as the second argument."
        )
    return source, assets
