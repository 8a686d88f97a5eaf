"""`meshdeform run`: deform one asset on this machine, or run a job of any kind on a service."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from meshdeform.cli.environment import load_settings, require
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.form import of_kind, of_request, with_options, written
from meshdeform.cli.jobs import refuse_unused_options, run_on_service
from meshdeform.cli.kinds import run_kind
from meshdeform.cli.local import check_glb, run_here, write_all
from meshdeform.cli.options import Here, JobWhere, Printed, SetOption, file_argument, file_option, option, output_option
from meshdeform.cli.report_lines import print_result
from meshdeform.cli.request import (
    DEFORMATION,
    make_request,
    merge_params,
    parse_files,
    parse_labels,
    parse_pictures,
    parse_targets,
)
from meshdeform.cli.results import check_animation, drawn_animation
from meshdeform.requests.choices import JobKind

_OUTPUTS = "Outputs"


def _file(text: str) -> Any:
    return option(text, _OUTPUTS, dir_okay=False)


@clean_errors
@with_options(
    of_kind("text_deform", short=DEFORMATION),
    of_request("output", _OUTPUTS),
    of_request("job", "Service", only=("kind", "priority", "deadline_s", "max_run_s", "retention_s")),
    usual="--output --also --seed --preset --guidance --target --strength --rig --keep --url",
)
def run(
    ctx: typer.Context,
    asset: Annotated[Path, file_argument("The GLB, OBJ, PLY, STL or ZIP; or what else jobs of --kind read.")],
    prompt: Annotated[
        str, typer.Argument(help='Its new shape, such as "a mushroom"; or --also, --target or --silhouette.')
    ] = "",
    output: Annotated[
        Path | None, output_option("The GLB to write (default: ASSET-deformed.glb here); with --url a folder.")
    ] = None,
    report: Annotated[Path | None, _file("Where the report goes (default: beside the GLB).")] = None,
    preview: Annotated[Path | None, _file("Where the picture goes (default: beside the GLB).")] = None,
    animate: Annotated[Path | None, _file("Also draw source to result and back, as this .webp or .gif.")] = None,
    target: Annotated[
        list[Path] | None,
        file_option("A mesh to deform towards, instead of a prompt; of several, the nearest is taken.", "Method"),
    ] = None,
    silhouette: Annotated[
        list[str] | None,
        option(
            "A picture whose silhouette the result should have, seen from an azimuth in degrees: 0 from +Z, 90 "
            "from +X; a mask, or an object in front of a plain background; up to four. With a prompt, both guide.",
            "Method",
            metavar="FILE@AZIMUTH",
        ),
    ] = None,
    param: SetOption = None,
    file: Annotated[
        list[str] | None, option("A further file that jobs of --kind read; repeatable.", "Service", metavar="PART=FILE")
    ] = None,
    label: Annotated[
        list[str] | None, option("A label of the job; repeatable.", "Service", metavar="NAME=TEXT")
    ] = None,
    idempotency_key: Annotated[str | None, option("The same key within a day returns the same job.", "Service")] = None,
    *,
    here: Here,
    where: JobWhere,
    printed: Printed,
) -> None:
    """Deform ASSET until it looks like PROMPT, on this machine or on a service.

    meshdeform run examples/sphere.glb "a mushroom" -o mushroom.glb

    meshdeform run examples/sphere.glb --target examples/vase.glb --url http://127.0.0.1:8765
    """
    job = written(ctx, "job")
    kind = JobKind(job.pop("kind", JobKind.TEXT_DEFORM))
    if animate is not None:
        check_animation(animate, "--animate")
    pictures = parse_pictures(silhouette)
    params = merge_params(ctx, param, silhouettes=pictures.views or None)
    outputs = written(ctx, "output")
    if "morph_path" in outputs:
        outputs["morph"] = True
    files = {**parse_files(file, kind, asset), **parse_targets(target), **pictures.files}
    refuse_unused_options(
        where,
        here={"--report": report, "--preview": preview, "--animate": animate, **here.written()},
        there={"--label": label, "--idempotency-key": idempotency_key, **where.written()},
    )
    job["metadata"] = parse_labels(label or [])
    if kind is not JobKind.TEXT_DEFORM:
        _refuse_deformation(kind, prompt, outputs)
        folder = output or Path(f"{asset.stem}-{kind}")
        run_kind(kind, params, files, folder, here, where, printed, idempotency_key=idempotency_key, **job)
        return
    request = make_request(prompt, params, output=outputs, more=job)
    if where.url:
        folder = output or Path(f"{asset.stem}-deformed")
        run_on_service(request, files, where, folder, printed, idempotency_key=idempotency_key)
        return
    require("scipy", "deform")
    output = output or Path(f"{asset.stem}-deformed.glb")
    check_glb(output)
    paths = {
        "result.glb": output,
        "report.json": report or output.with_suffix(".report.json"),
        "preview.png": preview or output.with_suffix(".preview.png"),
        **({"morph.glb": output.with_suffix(".morph.glb")} if request.output.morph else {}),
    }
    frames = {"animation": animate} if animate else {}
    run = run_here(request, files, paths, here, quiet=printed.quiet, also=list(frames.values()))
    if animate is not None:
        data = drawn_animation(asset, output, animate.suffix, load_settings(device=here.device, threads=here.threads))
        write_all({animate: data}, what=animate, advice="Choose another path with --animate.")
    print_result(kind, run, paths | frames, printed)


def _refuse_deformation(kind: JobKind, prompt: str, outputs: Mapping[str, Any]) -> None:
    """Refuse options that only a deformation has: a prompt, and those of the output."""
    if prompt:
        raise typer.BadParameter(f"a job of kind {kind} has no prompt", param_hint="PROMPT")
    for name in outputs:
        raise typer.BadParameter(f"is only for text_deform, not for {kind}", param_hint=f"--{name.replace('_', '-')}")
