"""`meshdeform run`: one deformation here and now, without a server."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.commands.environment import load_settings, require
from meshdeform.commands.exits import clean_errors
from meshdeform.errors import ParameterError

if TYPE_CHECKING:
    from meshdeform.config import JobRequest

__all__ = ["run"]


class _Preset(StrEnum):
    """`meshdeform.config.Preset`, spelled out so that `--help` need not import pydantic; a test compares them."""

    PREVIEW = "preview"
    BALANCED = "balanced"
    PAPER = "paper"


_OUTPUTS, _METHOD, _RESUME = "Outputs", "Method", "Interrupt and go on"


def _file(text: str, panel: str, *, exists: bool = False) -> Any:
    return typer.Option(help=text, rich_help_panel=panel, dir_okay=False, exists=exists, show_default=False)


@clean_errors
def run(
    asset: Annotated[
        Path, typer.Argument(help="The GLB, OBJ, PLY or STL to deform.", exists=True, dir_okay=False, readable=True)
    ],
    prompt: Annotated[
        str, typer.Argument(help='What it shall become, e.g. "a mushroom". Not needed with --target.')
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="The GLB to write. Default: ASSET-deformed.glb in this folder.", show_default=False
        ),
    ] = None,
    report: Annotated[Path | None, _file("Where the report goes (default: beside the GLB).", _OUTPUTS)] = None,
    preview: Annotated[Path | None, _file("Where the picture goes (default: beside the GLB).", _OUTPUTS)] = None,
    morph: Annotated[
        bool,
        typer.Option(help="Also write a morph.glb that moves from source to result.", rich_help_panel=_OUTPUTS),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON document instead of text.", rich_help_panel=_OUTPUTS)
    ] = False,
    preset: Annotated[
        _Preset, typer.Option(help="The set of parameters to start from.", rich_help_panel=_METHOD)
    ] = _Preset.BALANCED,
    steps: Annotated[int | None, typer.Option(help="Optimiser iterations.", rich_help_panel=_METHOD)] = None,
    seed: Annotated[int, typer.Option(help="Seed of every random draw.", rich_help_panel=_METHOD)] = 0,
    model: Annotated[
        str | None,
        typer.Option(help="`builtin`, or a Stable Diffusion checkpoint by hub id or folder.", rich_help_panel=_METHOD),
    ] = None,
    guidance_scale: Annotated[
        float | None, typer.Option(help="Classifier-free guidance.", rich_help_panel=_METHOD)
    ] = None,
    learning_rate: Annotated[float | None, typer.Option(help="Adam's step size.", rich_help_panel=_METHOD)] = None,
    target: Annotated[Path | None, _file("A mesh to become like, instead of a prompt.", _METHOD, exists=True)] = None,
    param: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE", help="Any other parameter (docs/parameters.md); repeatable.", rich_help_panel=_METHOD
        ),
    ] = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.", rich_help_panel=_METHOD)] = None,
    threads: Annotated[
        int | None, typer.Option(min=0, help="CPU threads; 0: all cores.", rich_help_panel=_METHOD)
    ] = None,
    checkpoint: Annotated[
        Path | None, _file("Keep the state here, every so many steps and at Ctrl-C.", _RESUME)
    ] = None,
    resume: Annotated[Path | None, _file("Go on from such a state.", _RESUME, exists=True)] = None,
) -> None:
    """Deform ASSET until it looks like PROMPT."""
    require("torch", "worker")
    settings = load_settings(device=device, threads=threads)
    output = output or Path(f"{asset.stem}-deformed.glb")
    if output.suffix.lower() != ".glb":
        raise typer.BadParameter(f"the result is a GLB; {output.name} does not end in .glb", param_hint="--output")
    request = _request(
        prompt,
        {
            **_written(param or []),
            "preset": preset.value,
            "guidance": "target" if target else "sds",
            "model": model,
            "steps": steps,
            "seed": seed,
            "guidance_scale": guidance_scale,
            "learning_rate": learning_rate,
        },
        morph=morph,
    )
    from meshdeform.kinds import text_deform_check

    # Before torch is imported, which takes seconds: a word that the prior does not know is told at once.
    text_deform_check.check(
        request,
        default_model=settings.model,
        allowed_models=[model] if model else [],
        revision=settings.model_revision,
        has_target=target is not None,
    )
    from meshdeform.commands.local_job import LocalJob, Outputs
    from meshdeform.commands.progress import show_progress

    outputs = Outputs(
        result=output,
        report=report or output.with_suffix(".report.json"),
        preview=preview or output.with_suffix(".png"),
        morph=output.with_suffix(".morph.glb") if morph else None,
        checkpoint=checkpoint,
    )
    job = LocalJob(asset, request, settings, outputs, target=target, resume=resume)
    with show_progress() as progress:
        summary = job.run(progress)
    if as_json:
        typer.echo(json.dumps(summary))
        return
    names = {"result": "GLB", "morph": "Morph GLB", "report": "Report", "preview": "Picture"}
    for name, title in names.items():
        if summary[name] is not None:
            typer.echo(f"{title:<10} {summary[name]}")


def _written(pairs: list[str]) -> dict[str, Any]:
    """Parameters written as NAME=VALUE; values are JSON where they can be, else text."""
    parameters: dict[str, Any] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals:
            raise typer.BadParameter(f"{pair!r} is not NAME=VALUE", param_hint="--param")
        try:
            parameters[name.strip()] = json.loads(value)
        except ValueError:
            parameters[name.strip()] = value
    return parameters


def _request(prompt: str, params: dict[str, Any], *, morph: bool) -> JobRequest:
    from pydantic import ValidationError

    from meshdeform.config import JobRequest

    given = {name: value for name, value in params.items() if value is not None}
    try:
        return JobRequest.model_validate({"prompt": prompt, "params": given, "output": {"morph": morph}})
    except ValidationError as error:
        sentences = [f"{'.'.join(str(part) for part in e['loc'])}: {e['msg']}" for e in error.errors()]
        raise ParameterError(
            f"The request is not valid: {'; '.join(sentences)}.",
            advice="docs/parameters.md has every parameter with its bounds.",
        ) from error
