"""`meshdeform teach`: teach the builtin prior a noun from meshes, by a job of kind `prior_teach`, here or elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from meshdeform.cli.environment import require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import form_command, of_kind, written
from meshdeform.cli.jobs import refuse_other_place, run_on_service
from meshdeform.cli.local import run_here
from meshdeform.cli.options import Here, JobPlace, Printed
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import make_request
from meshdeform.errors import ParameterError

__all__ = ["TeachCommand", "teach"]

TeachCommand = form_command(of_kind("prior_teach", "Lesson", hidden=("noun", "synonyms", "front_deg")))


@clean_errors
def teach(
    ctx: typer.Context,
    noun: Annotated[str, typer.Argument(help='What the meshes show: "a teapot".')],
    meshes: Annotated[
        list[Path],
        typer.Argument(
            help="GLB, OBJ, PLY, STL or ZIP files, or folders of them. The subfolders of a folder are named by "
            "attributes: tall, long-nose.",
            exists=True,
            readable=True,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The file of weights, default: NOUN.safetensors; with --url a folder."),
    ] = None,
    synonym: Annotated[list[str] | None, typer.Option(help="Another name of the same thing; repeatable.")] = None,
    front: Annotated[
        float, typer.Option(min=-360, max=360, help="Azimuth of the front of the meshes: 0 is +Z, 90 is +X.")
    ] = 0.0,
    family: Annotated[
        Path | None,
        typer.Option(
            help="The family.safetensors that family-fit found in the meshes: members are new shapes of it.",
            exists=True,
            dir_okay=False,
            show_default=False,
        ),
    ] = None,
    device: Annotated[str | None, typer.Option(help="auto, cpu, cuda or cuda:N.")] = None,
    *,
    here: Here,
    place: JobPlace,
    printed: Printed,
) -> None:
    """Teach the builtin model a noun from your own meshes, so that prompts may name it.

    meshdeform teach "a teapot" teapots/*.glb -o mine.safetensors

    meshdeform run sphere.glb "a teapot" --model mine.safetensors
    """
    params = {"noun": noun, "synonyms": synonym or [], "front_deg": front, **written(ctx)}
    request = make_request("", params, more={"kind": "prior_teach"})
    data, filename = _packed(meshes)
    refuse_other_place(place, here={"--device": device, **here.written()}, there={})
    if place.url:
        sent: dict[str, Path | bytes] = {"meshes": data, **({"family": family} if family else {})}
        run_on_service(request, sent, place, output or Path(_slug(noun)), printed, filename=filename)
        return
    require("torch", "deform")
    output = output or Path(f"{_slug(noun)}.safetensors")
    if output.suffix != ".safetensors":
        raise typer.BadParameter(f"{output.name} does not end in .safetensors", param_hint="--output")
    from meshdeform.runs.base import InputFile
    from meshdeform.runs.sent_weights import WEIGHTS_ARTIFACT

    paths = {
        WEIGHTS_ARTIFACT: output,
        "report.json": output.with_suffix(".report.json"),
        "preview.png": output.with_suffix(".preview.png"),
    }
    files: dict[str, Path | InputFile] = {"meshes": InputFile(data, filename), **({"family": family} if family else {})}
    inputs = [*meshes, Path(request.params.model or "builtin")]
    run = run_here(request, files, paths, here, quiet=printed.quiet, device=device, inputs=inputs)
    print_result(request.kind, run, paths, printed)


def _packed(meshes: list[Path]) -> tuple[bytes, str]:
    """Return the meshes as the part of a job, with its file name: one file as it is, several as a ZIP."""
    from meshdeform.client.sources import packed_meshes

    try:
        data, filename = packed_meshes(meshes[0] if len(meshes) == 1 else meshes)
    except ValueError as error:
        raise ParameterError(str(error)) from error
    return (data, filename or "mesh") if isinstance(data, bytes) else (meshes[0].read_bytes(), meshes[0].name)


def _slug(noun: str) -> str:
    """Return the noun without its article, as the name of a file."""
    from meshdeform.support.files import slug

    first, _, rest = noun.strip().partition(" ")
    return slug(rest if first.lower() in ("a", "an", "the") and rest else noun) or "noun"
